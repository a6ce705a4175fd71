"""Anisotropic halfspaces, lattices of springs and tables: closed forms, limits, symmetries, contacts."""

import io
import math

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import Anisotropic, Elastic, Lattice, Tabulated, TractionSpectrum, Wavevectors, Zener
from gfmdlayer.body.closed_form import LayeredHalfspace
from gfmdlayer.body.solid import fault, fault_under_shear
from gfmdlayer.case.model import model_of

R = math.sqrt(0.5)


def cubic(next_nearest, **more):
    return Lattice(crystal="simple_cubic", nearest=1.0, next_nearest=next_nearest, spacing=1.0, **more)


def fcc(**more):
    """Edge of the cubic cell 1: surface atoms at a distance of 2^-1/2."""
    return Lattice(crystal="fcc", nearest=1.0, spacing=R, **more)


def at(angles, q):
    phi = np.radians(angles)
    return Wavevectors.of_components(q * np.cos(phi), q * np.sin(phi))


# Of an independent solution by Stroh's eigenproblem: K/q along 0, 22.5 and 45 degrees from the surface axis;
# the first-order part of the lattice's K/K_continuum - 1 over q times the spacing; K b at (pi, 0), (pi, pi),
# (pi/2, 0) and (pi/2, pi/2): closed forms at the first two, else one big matrix.
LATTICES = {
    "k2 = k1": (cubic(1.0), (4 / 3, 4 / 3, 4 / 3), (1 / 12, 0.0937500, 0.1041667),
                (8**0.5, 8**0.5, 2.058493404377, 2.565511329447)),
    "k2 = k1/2": (cubic(0.5), (0.818317088, 0.812985996, 0.808145213), (0.0981980, 0.1028890, 0.1078326),
                  (3**0.5, 2.0, 1.257257101639, 1.628371063618)),
    "k2 = 2 k1": (cubic(2.0), (2.312023907, 2.328553840, 2.346371951), (0.0707762, 0.0863171, 0.1006044),
                  (24**0.5, 4.0, 3.568065590679, 4.288983351519)),
    "fcc": (fcc(), (0.994411576, 0.969387385, 0.948683298), (0.0671453, 0.0544400, 0.0372678),
            ((8 / 3) ** 0.5 * 2 * R, 4 * R, 1.571726345359, 2.058332061573)),
}  # fmt: skip


def continuum(lattice):
    C11, C12, C44 = lattice.constants
    return Anisotropic(C11=C11, C12=C12, C44=C44, angle=45.0 if lattice.crystal == "fcc" else 0.0)


@pytest.mark.parametrize("name", LATTICES)
def test_long_waves_of_a_lattice_are_those_of_its_continuum_and_short_ones_of_its_springs(name):
    lattice, expected, first, short = LATTICES[name]
    assert isinstance(lattice.material, Elastic)
    angles = [0.0, 22.5, 45.0]
    limit = continuum(lattice).stiffness(at(angles, 1.0), 0.0)
    np.testing.assert_allclose(limit, expected, rtol=1e-9)
    off = []
    for qb in (2e-3, 1e-3):
        found = lattice.stiffness(at(angles, qb / lattice.spacing), 0.0) / (qb / lattice.spacing)
        off.append((found / limit - 1) / qb)
    np.testing.assert_allclose(2 * off[1] - off[0], first, atol=1e-6)  # the next order is extrapolated
    tiny = lattice.stiffness(at(angles, 1e-7), 0.0) / 1e-7
    np.testing.assert_allclose(tiny, limit, rtol=1e-7)  # no digits are lost but by the first order itself
    x, y = np.pi * np.array([[1, 1, 0.5, 0.5], [0, 1, 0, 0.5]]) / lattice.spacing
    found = lattice.stiffness(Wavevectors.of_components(x, y), 0.0) * lattice.spacing
    np.testing.assert_allclose(found, short, rtol=1e-11)


@pytest.mark.parametrize("lattice", [*(cubic(ratio) for ratio in (0.05, 1.0, 20.0)), fcc(), fcc(layers=3)])
def test_lattices_are_stable_on_the_whole_zone(lattice):
    q = 2 * np.pi * np.fft.fftfreq(64) / lattice.spacing
    waves = Wavevectors.of_components(q[:, np.newaxis], q)
    found = lattice.stiffness(waves, 0.0)
    assert (found[waves.magnitude > 0] > 0).all()
    # Fourfold axis and mirrors of both faces.
    np.testing.assert_allclose(found, found.T, rtol=1e-10)
    np.testing.assert_allclose(found[1:], found[:0:-1], rtol=1e-10)


@pytest.mark.parametrize(
    ("lattice", "expected"),
    [
        (cubic(1.0), 0.745147757896),
        (cubic(1.0, layers=4), 0.898513186592),
        (fcc(), 0.535471993935),
        (fcc(layers=4), 0.763185188684),
    ],
)
def test_layers_on_a_rigid_one_are_stiffer(lattice, expected):
    waves = Wavevectors.of_components([0.0, 0.5 / lattice.spacing], [0.0, 0.2 / lattice.spacing])
    found = lattice.stiffness(waves, 0.0)
    assert found[1] * lattice.spacing == pytest.approx(expected, rel=1e-11)
    assert found[0] == pytest.approx(lattice.mean_stiffness, rel=1e-12)


def test_many_layers_tend_to_a_layer_on_a_rigid_base_in_the_first_order():
    """Poisson's ratio 1/4, q d = 1: off by 3.16e-4 and 4.71e-5 with 8 and 64 layers."""
    off = []
    for layers in (8, 64):
        layer = LayeredHalfspace(float(layers), 0.25, math.inf)
        K = cubic(1.0, layers=layers).stiffness(np.array([1.0 / layers]), 0.0)
        off.append(float(K[0]) / float(layer.stiffness(1.0 / layers, 1.0)) - 1)
    np.testing.assert_allclose(np.abs(off), [3.16e-4, 4.71e-5], rtol=5e-3)


def test_an_isotropic_halfspace_is_one_of_all_directions():
    """K = q G/(1 - nu) with C11 - C12 = 2 C44; a transversely isotropic one has no direction in the plane."""
    angles = np.linspace(0, 360, 13)
    one = Anisotropic(C11=3.0, C12=1.0, C44=1.0)
    np.testing.assert_allclose(one.stiffness(at(angles, 2.0), 0.0), 2 / 0.75, rtol=1e-13)
    other = Anisotropic(C11=163.0, C12=34.8, C13=51.6, C33=181.0, C44=57.3, C66=(163.0 - 34.8) / 2)
    found = other.stiffness(at(angles, 1.0), 0.0)
    # A. Delafargue and F.-J. Ulm, Int. J. Solids Struct. 41 (2004) 7351: the indentation modulus is 2 K/q.
    C11, C13, C33, C44 = 163.0, 51.6, 181.0, 57.3
    softness = 1 / C44 + 2 / (math.sqrt(C11 * C33) + C13)
    np.testing.assert_allclose(found, math.sqrt((C11 * C33 - C13**2) / (C11 * softness)), rtol=1e-12)


def test_bodies_turn_with_their_angle_and_keep_their_promises(tmp_path):
    turned = Anisotropic(C11=165.8, C12=63.9, C44=79.6, angle=20.0)
    plain = Anisotropic(C11=165.8, C12=63.9, C44=79.6)
    waves, back = at([30.0, 110.0], 3.0), at([10.0, 90.0], 3.0)
    np.testing.assert_allclose(turned.stiffness(waves, 0.0), plain.stiffness(back, 0.0), rtol=1e-13)
    table = tmp_path / "stiffness.txt"
    table.write_text("0.1 0.2\n1 2\n100 200\n")
    law = Zener(G0=2.0, Ginf=8.0, tau=0.5)
    grid = Wavevectors.of_components([0.0, 1.0, 2.0, -3.0], [0.0, 0.5, -1.0, 0.0])
    for body in (
        plain.model_copy(update={"material": law}),
        cubic(0.5, material=law, layers=3),
        fcc(material=law),
        Tabulated(table=table, material=law),
    ):
        assert fault(body, grid) == ""
        glassy = body.spectrum(grid).glassy
        np.testing.assert_allclose(glassy, 4 * body.stiffness(grid, 0.0), rtol=1e-12)  # Ginf/G0


def test_a_table_is_a_body_between_its_rows(tmp_path):
    table = tmp_path / "stiffness.txt"
    q = np.geomspace(1.0, 1e4, 30)
    np.savetxt(table, np.column_stack((q, 2 * q)))
    config = {"grid": {"points": 512}, "time": {"end": 1.0, "step": 0.5}, "trajectory": {"depth": 0.005}}
    found = gfmdlayer.run(config, body={"kind": "table", "table": str(table)})
    alone = gfmdlayer.run(
        config, layer={"thickness": math.inf, "poisson": 0.5, "material": {"model": "elastic", "G": 1.0}}
    )
    np.testing.assert_allclose(found.mean_stress, alone.mean_stress, rtol=1e-5)
    np.savetxt(table, np.column_stack((q[:10], 2 * q[:10])))
    with pytest.raises(gfmdlayer.ConfigError, match=r"has q from 1 to .*must hold those of the grid"):
        gfmdlayer.run(config, body={"kind": "table", "table": str(table)})


def test_an_array_of_another_code_is_a_body_on_its_grid(tmp_path):
    """The stiffness of a lattice over the waves of a grid, in the order of NumPy's FFT."""
    n, lattice = 32, Lattice(crystal="fcc", nearest=1.0, spacing=1 / 32)
    q = 2 * np.pi * np.fft.fftfreq(n, 1 / n)
    table = tmp_path / "lattice.npy"
    np.save(table, lattice.stiffness(Wavevectors.of_components(q[:, np.newaxis], q), 0.0))
    config = {"grid": {"points": [n, n]}, "time": {"end": 1.0, "step": 0.5}}
    config |= {"punch": {"shape": "parabola", "radius": [1.0, 2.0]}, "trajectory": {"depth": 0.01}}
    own = {"kind": "table", "table": str(table), "period": 1.0}
    crystal = {"kind": "lattice", "crystal": "fcc", "nearest": 1.0, "spacing": 1 / n}
    one, other = (gfmdlayer.run(config, body=body).force for body in (own, crystal))
    np.testing.assert_allclose(one, other, rtol=1e-10)
    for body, message in (
        (own | {"period": 2.0}, r"body\.period: got 2\.0; must be grid\.period"),
        (
            {key: own[key] for key in ("kind", "table")},
            r"body\.period: missing; a \.npy file needs the period",
        ),
    ):
        with pytest.raises(gfmdlayer.ConfigError, match=message):
            gfmdlayer.run(config, body=body)
    with pytest.raises(
        gfmdlayer.ConfigError, match=r"holds an array of shape \(32, 32\); must be that of grid"
    ):
        gfmdlayer.run(config | {"grid": {"points": [16, 32]}}, body=own)


def stroh(constants, axes, phi):
    """Return K/q by Stroh's six-dimensional eigenproblem; the rows of `axes` are x, y and z of the grid."""
    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    C = np.asarray(constants)[voigt[:, :, None, None], voigt]
    e, z = np.cos(phi) * axes[0] + np.sin(phi) * axes[1], axes[2]
    Q, R, T = (np.einsum("j,ijkl,l", a, C, b) for a, b in ((e, e), (e, z), (z, z)))
    W = np.linalg.inv(T)
    p, v = np.linalg.eig(np.block([[-W @ R.T, W], [R @ W @ R.T - Q, -R @ W]]))
    A, B = v[:3, p.imag > 0], v[3:, p.imag > 0]
    return float(1 / (z @ (1j * A @ np.linalg.inv(B)) @ z).real)


def test_any_elastic_constants_in_any_orientation_agree_with_stroh():
    random = np.random.default_rng(4)
    for _ in range(8):
        X, z = random.standard_normal((6, 6)), random.standard_normal(3)
        C, x = X @ X.T + 2 * np.eye(6), np.cross(z, random.standard_normal(3))
        body = Anisotropic(C=((C + C.T) / 2).tolist(), normal=z.tolist(), along=x.tolist(), angle=17.0)
        axes = np.array([each / np.linalg.norm(each) for each in (x, np.cross(z, x), z)])
        phi = random.uniform(0, 2 * np.pi, 3)
        found = body.stiffness(at(np.degrees(phi), 2.0), 0.0) / 2.0
        expected = [stroh(C, axes, each - np.radians(17.0)) for each in phi]
        # The eigenvectors of a random body lose two digits.
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_orientation_turns_the_crystal():
    """About [001] like `angle`; the threefold axis of a face (111) is a sixfold one of K(q) = K(-q)."""
    silicon = {"C11": 165.8, "C12": 63.9, "C44": 79.6}
    turned, angled = Anisotropic(**silicon, along=(1, 1, 0)), Anisotropic(**silicon, angle=-45.0)
    waves = at([0.0, 10.0, 50.0], 3.0)
    np.testing.assert_allclose(turned.stiffness(waves, 0.0), angled.stiffness(waves, 0.0), rtol=1e-13)
    matrix = Anisotropic(C=Anisotropic(**silicon).constants)
    assert (matrix.stiffness(waves, 0.0) == Anisotropic(**silicon).stiffness(waves, 0.0)).all()
    face = Anisotropic(**silicon, normal=(1, 1, 1), along=(1, -1, 0))
    six = face.stiffness(at(10.0 + 60.0 * np.arange(6), 1.0), 0.0)
    np.testing.assert_allclose(six, six[0], rtol=1e-12)
    assert face.stiffness(at(40.0, 1.0), 0.0) != pytest.approx(six[0], rel=1e-3)


def coefficients(n, m, axes):
    """Return random Hermitian Phi(q) > 0 with Phi(-q) = conj Phi(q), shape (n, m, axes, axes)."""
    fields = np.random.default_rng(5).standard_normal((n, m, axes, axes))
    A = np.fft.fft2(fields, axes=(0, 1))
    return A @ A.swapaxes(-1, -2).conj() + np.eye(axes)


def fix_gfc(Phi, cell, atoms=1):
    """Return the file that LAMMPS's `fix gfc` writes."""
    n, m, size, _ = Phi.shape
    head = np.array([size // atoms, n, m, atoms], dtype="<i4").tobytes() + np.float64(8.6e-5).tobytes()
    return bytes(head + Phi.astype("<c16").tobytes() + np.ravel(cell).tobytes() + np.zeros(size).tobytes())


def test_stiffness_measured_by_molecular_dynamics_is_a_body(tmp_path):
    """The relaxed stiffness of the atoms along the normal: Phi_zz less what the other directions give."""
    Phi, table = coefficients(8, 10, 3), tmp_path / "crystal.bin.5000"
    table.write_bytes(fix_gfc(Phi, [[0.5, 0], [0, 0.25]]))
    inner, side = np.linalg.inv(Phi[..., :2, :2]), Phi[..., :2, 2:]
    freed = Phi[..., 2, 2] - (side.swapaxes(-1, -2).conj() @ inner @ side)[..., 0, 0]
    K = freed.real / (0.5 * 0.25)
    qx, qy = (2 * np.pi * np.fft.fftfreq(n, d) for n, d in ((8, 0.5), (10, 0.25)))
    waves = Wavevectors.of_components(qx[:, np.newaxis], qy)
    found = Tabulated(table=table).stiffness(waves, 0.0)
    np.testing.assert_allclose(found[waves.magnitude > 0], K[waves.magnitude > 0], rtol=1e-12)
    assert found[0, 0] == 0

    import h5py

    other = tmp_path / "crystal.h5"
    with h5py.File(other, "w") as h5:
        h5["stiffness"] = K
        h5["stiffness"].attrs["period"] = [4.0, 2.5]
    np.testing.assert_allclose(Tabulated(table=other).stiffness(waves, 0.0), found, rtol=1e-12)
    config = {"grid": {"points": [8, 10], "period": [4.0, 2.5]}, "trajectory": {"depth": 0.01}}
    config |= {"time": {"end": 1.0, "step": 1.0}, "punch": {"shape": "parabola", "radius": 2.0}}
    one, two = (gfmdlayer.run(config, body={"kind": "table", "table": str(each)}) for each in (table, other))
    assert float(one.force[-1]) == pytest.approx(float(two.force[-1]), rel=1e-10)


def test_a_chain_of_atoms_is_a_line(tmp_path):
    Phi, table = coefficients(16, 1, 2), tmp_path / "chain.bin.1"
    table.write_bytes(fix_gfc(Phi, [[0.5, 0], [0, 0]]))
    freed = Phi[:, 0, 1, 1].real - np.abs(Phi[:, 0, 0, 1]) ** 2 / Phi[:, 0, 0, 0].real
    q = 2 * np.pi * np.arange(1, 9) / 8.0
    np.testing.assert_allclose(Tabulated(table=table).stiffness(q, 0.0), freed[1:9] / 0.5, rtol=1e-12)


def saved(values):
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("bin.5000", b"short", "it ends within its head"),
        ("bin.5000", fix_gfc(coefficients(8, 8, 3), [[1, 0.0], [0, 1]])[:-8], "it has .* bytes; must be"),
        ("bin.5000", fix_gfc(coefficients(8, 8, 6), [[1, 0.0], [0, 1]], atoms=2),
         "its cells have 2 atoms; must have one"),
        ("bin.5000", fix_gfc(coefficients(8, 8, 3), [[1, 0.0], [0.5, 1]]), "its cells are skew"),
        ("bin.5000", fix_gfc(coefficients(8, 8, 3), [[1, 0.0], [0, 1]]),
         r"has the period \[8.0, 8.0\]; must be"),
        ("npy", saved(np.arange(64.0).reshape(8, 8) + 1), "differs between q and -q"),
        ("npy", saved(-np.ones((8, 8))), "must hold finite numbers along one axis or two, > 0"),
        ("npy", saved(np.ones((8, 8)) + 1j), "cannot be read as an array"),
        ("h5", b"no HDF5", "cannot be read as an array"),
    ],
)  # fmt: skip
def test_files_that_hold_no_stiffness_are_refused(tmp_path, name, data, message):
    table = tmp_path / f"crystal.{name}"
    table.write_bytes(data)
    body = {"kind": "table", "table": str(table)} | ({"period": 1.0} if name == "npy" else {})
    with pytest.raises(gfmdlayer.ConfigError, match=message):
        gfmdlayer.Config(name="a", grid={"points": [8, 8], "period": 1.0}, body=body)


def test_atoms_are_points_of_the_grid_in_solve_too():
    with pytest.raises(gfmdlayer.ConfigError, match=r"body\.spacing: got 1\.0; must be 0\.125"):
        gfmdlayer.solve(cubic(1.0), gfmdlayer.Parabola(radius=1.0), depth=0.01, points=(8, 8), period=1.0)


def test_a_contact_on_a_crystal_tends_to_that_on_its_continuum():
    """A sphere of 2^-1/2 times the number of atoms over the radius; the area is known to a ring of atoms."""
    areas = []
    for points in (32, 96):
        base = {"grid": {"points": [points, points]}, "time": {"end": 1.0, "step": 1.0}}
        base |= {"punch": {"shape": "parabola", "radius": 1.0}, "trajectory": {"depth": 0.01}}
        crystal = {"kind": "lattice", "crystal": "fcc", "nearest": 1.0, "spacing": 1 / points}
        lattice = Lattice(**{key: value for key, value in crystal.items() if key != "kind"})
        C11, C12, C44 = lattice.constants
        halfspace = {"kind": "anisotropic", "C11": C11, "C12": C12, "C44": C44, "angle": 45.0}
        one, other = (gfmdlayer.run(base, body=body) for body in (crystal, halfspace))
        areas.append(float(one.force[-1] / other.force[-1]))
    # The surface is stiffer by beta q b: an atom in a contact of 3 and 10 atoms' radius.
    assert 1 < areas[1] < areas[0] < 1.1
    assert (areas[0] - 1) / (areas[1] - 1) == pytest.approx(3.0, rel=0.3)


def test_more_points_are_no_remedy_where_they_are_atoms():
    law = {"model": "zener", "G0": 1.0, "Ginf": 4.0, "tau": 1.0}
    crystal = {"kind": "lattice", "nearest": 1.0, "spacing": 1 / 16, "material": law}
    config = {
        "grid": {"points": [16, 16]},
        "punch": {"shape": "parabola"},
        "time": {"end": 2.0, "step": 0.25},
    }
    config["trajectory"] = {"depth": 0.005, "velocity": 0.3}
    with pytest.warns(UserWarning, match="UNBALANCED") as caught:
        gfmdlayer.run(config, body=crystal)
    said = "\n".join(str(each.message) for each in caught)
    assert "in contact; these are its atoms" in said
    assert "grid.points" not in said


@pytest.mark.parametrize("method", ["active_set", "nested_gradient", "conjugate_gradient"])
def test_all_solvers_find_the_same_contact_on_a_lattice(method):
    config = {"grid": {"points": [32, 32]}, "time": {"end": 1.0, "step": 1.0}, "trajectory": {"depth": 0.01}}
    config |= {"body": {"kind": "lattice", "crystal": "fcc", "nearest": 1.0, "spacing": 1 / 32}}
    config |= {"punch": {"shape": "parabola", "radius": 1.0}, "output": {"snapshots": [1.0]}}
    one, other = (
        gfmdlayer.run(config, solver={"method": each, "tolerance": 1e-10}).pressure
        for each in (method, "fire")
    )
    assert float(abs(one - other).max()) < 1e-7 * float(one.max())


# Friction: K(q) over all directions.

G, NU = 1.3, 0.3
LAME = 2 * G * NU / (1 - 2 * NU)
ISOTROPIC = {"C11": LAME + 2 * G, "C12": LAME, "C44": G}
HEXAGONAL = {"C11": 5.0, "C12": 2.0, "C13": 1.5, "C33": 7.0, "C44": 1.2, "C66": 1.5}
RELAXING = Zener(G0=1.0, Ginf=5.0, tau=1.0)


@pytest.mark.parametrize("s", [0.0, 0.5, 1e9])
def test_an_isotropic_crystal_answers_to_shear_like_a_halfspace(s):
    waves = at([0, 30, 200], np.array([0.5, 1.0, 2.0]))
    found = Anisotropic(**ISOTROPIC, material=RELAXING).traction_spectrum(waves)
    exact = gfmdlayer.halfspace(Zener(G, 5 * G, 1.0), poisson=NU).traction_spectrum(waves)
    assert found.in_plane.stiffness(s) == pytest.approx(exact.in_plane.stiffness(s), rel=1e-12)
    assert found.across.stiffness(s) == pytest.approx(exact.across.stiffness(s), rel=1e-12)


def test_a_sixfold_axis_has_the_closed_form_across_and_its_own_stiffness_under_pressure():
    """Shear across the waves is antiplane: K = q (C44 C66)^(1/2)."""
    body, waves = Anisotropic(**HEXAGONAL), at([0, 10, 45, 90], 2.0)
    found = body.traction_spectrum(waves)
    assert found.across.relaxed == pytest.approx(2 * math.sqrt(1.2 * 1.5), rel=1e-12)
    K = found.in_plane.relaxed
    free = K[:, 0, 0] - K[:, 0, 1] ** 2 / K[:, 1, 1]  # no shear traction
    assert free == pytest.approx(body.stiffness(waves, 0.0), rel=1e-12)
    assert (K.swapaxes(1, 2) == K).all()
    assert not fault_under_shear(body, Wavevectors.of_components(np.r_[0, waves.qx], np.r_[0, waves.qy]))


@pytest.mark.parametrize("points", [64, [24, 24]], ids=["line", "surface"])
def test_friction_on_an_isotropic_crystal_is_that_on_a_halfspace(points):
    given = {
        "name": "a", "grid": {"points": points}, "interface": {"law": "coulomb", "coefficient": 0.3},
        "trajectory": {"depth": 0.02, "ramp_time": 0.5, "tangential": {"displacement": 0.005}},
        "time": {"end": 1.0, "step": 0.125},
    }  # fmt: skip
    law = {"model": "zener", "G0": G, "Ginf": 5 * G, "tau": 1.0}
    one = gfmdlayer.run(given | {"body": {"kind": "anisotropic", **ISOTROPIC, "material": law}})
    layer = {"thickness": 0.5, "poisson": NU, "material": law}
    two = gfmdlayer.run(given | {"layer": layer, "halfspace": {"poisson": NU, "material": law}})
    for name in ("force", "tangential_force", "slip_heat", "dissipated"):
        # K agrees to 1e-12, solutions to the tolerance of the solver, 1e-6 of the largest, at most.
        assert one[name].values == pytest.approx(two[name].values, rel=1e-7, abs=1e-12)


def test_a_crystal_that_shear_moves_across_the_waves_is_refused_before_a_run():
    cubic_face = {"kind": "anisotropic", "C11": 165.8, "C12": 63.9, "C44": 79.6}
    given = {"name": "a", "grid": {"points": [16, 16]}, "interface": {"law": "coulomb", "coefficient": 0.3}}
    with pytest.raises(gfmdlayer.ConfigError, match="the normal must be a sixfold axis"):
        gfmdlayer.run(given | {"body": cubic_face})
    (refusal,) = model_of(gfmdlayer.Config(**given, body=cubic_face)).problems()
    assert refusal[0] == "body"
    line = given | {"grid": {"points": 64}, "body": cubic_face}
    assert not list(model_of(gfmdlayer.Config(**line)).problems())


class Own(gfmdlayer.Solid):
    """A halfspace of a user, with the matrix over the directions, off by a factor."""

    factor: float = 1.0

    def stiffness(self, waves, s):
        return gfmdlayer.halfspace(G, poisson=NU).stiffness(waves, s)

    def spectrum(self, waves):
        return gfmdlayer.halfspace(G, poisson=NU).spectrum(waves)

    def traction_spectrum(self, waves):
        q = np.asarray(waves)
        K = np.array([[2 - 2 * NU, 2 * NU - 1], [2 * NU - 1, 2 - 2 * NU]]) * 2 / (3 - 4 * NU)
        return TractionSpectrum.of_material(self.factor * np.multiply.outer(q, K), q, Elastic(G))


def test_a_body_of_a_user_with_the_matrix_goes_with_friction():
    punch = gfmdlayer.Parabola(radius=1.0)
    given = {"force": 0.02, "points": (32, 32), "friction": 0.3, "tangential_force": 0.003}
    one, two = (gfmdlayer.solve(each, punch, **given) for each in (Own(), gfmdlayer.halfspace(G, poisson=NU)))
    assert float(one.tangential_displacement_x) == pytest.approx(float(two.tangential_displacement_x))
    waves = Wavevectors.of_components(np.arange(4.0), np.zeros(4))
    assert not fault_under_shear(Own(), waves)
    assert "without shear traction is not stiffness(waves, s)" in fault_under_shear(Own(factor=1.1), waves)
    assert "is not positive" in fault_under_shear(Own(factor=-1.0), waves)
