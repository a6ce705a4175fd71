"""Published values beside those of this code, as Markdown; the page docs/verification/published.md.

python scripts/published.py               # all tables, half a minute
python scripts/published.py rolling       # one of them: see SECTIONS
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

import gfmdlayer
from gfmdlayer.verification.adhesion import sphere as maugis
from gfmdlayer.verification.indentation import pull_off
from gfmdlayer.verification.stacks import pavement

_HEAD = """\
# Published values beside ours

Numbers that others printed or computed, beside those of this code. The command above each table computes the
column "here"; the build of this page runs it. A difference beyond the last printed digit is in **bold**. Some
printed tables have wrong digits.

"""
# Hayes, Keer, Herrmann & Mockros, J. Biomech. 5 (1972) 541, Table 1, Poisson's ratio 0.5: a/h and kappa.
_HAYES = {
    0.2: "1.281", 0.4: "1.683", 0.6: "2.211", 0.8: "2.855", 1.0: "3.609", 1.5: "5.970", 2.0: "9.069",
    2.5: "13.00", 3.0: "17.86", 3.5: "23.74", 4.0: "30.75",
}  # fmt: skip
_DIMITRIADIS = (1.0, 1.133, 1.283, 0.769, 0.0975)
_GARCIA = (1.0, 1.133, 1.497, 1.469, 0.755)


def _layer() -> gfmdlayer.ViscoelasticLayer:
    return gfmdlayer.bonded_layer(thickness=1.0, material=gfmdlayer.Elastic(1.0), poisson=0.5)


def _force(punch: gfmdlayer.FlatPunch | gfmdlayer.Parabola, depth: float) -> float:
    curve = gfmdlayer.indent(_layer(), punch, np.array([0.0, 1.0]), depth=np.array([0.0, depth]))
    return float(curve.force[-1])


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield f"|{'---:|' * len(head)}"
    yield from (f"| {' | '.join(row)} |" for row in rows)
    yield ""


def _beside(printed: str, found: float) -> tuple[str, str, str]:
    """Return a printed value, the one found to one digit more, and their difference."""
    digits = len(printed.partition(".")[2])
    off = float(printed) / found - 1
    wrong = abs(float(printed) - found) > 0.5000001 * 10.0**-digits
    difference = f"{100 * off:+.2f} %"
    return printed, f"{found:.{digits + 1}f}", f"**{difference}**" if wrong else difference


def flat_punch() -> Iterator[str]:
    """Yield the table of Hayes et al."""
    yield """\
## Flat punch on a bonded incompressible layer

κ = F (1 − ν)/(4 G a δ) for a cylinder of radius a on a layer of thickness h, ν = 0.5, on a rigid base. In
print: Hayes, Keer, Herrmann & Mockros, *J. Biomech.* 5 (1972) 541, a table in use for cartilage to this day.
Its error grows with a/h; moduli from this table have the same error.
"""
    rows = (
        (f"{a:g}", *_beside(printed, _force(gfmdlayer.FlatPunch(radius=a), 0.1) * 0.5 / (0.4 * a)))
        for a, printed in _HAYES.items()
    )
    yield from _table(("a/h", "in print", "here", "difference"), rows)


def sphere() -> Iterator[str]:
    """Yield the polynomials of Dimitriadis and Garcia."""
    yield """\
## Sphere on a bonded incompressible layer

The force over the force of Hertz is a function of χ = √(Rδ)/h. Two papers print polynomials in χ:
Dimitriadis et al., *Biophys. J.* 82 (2002) 2798, and Garcia & Garcia, *Biophys. J.* 114 (2018) 2923. [Force
curves of indenters](../theory/indentation.md) has the effect of these errors on fits.
"""
    rows = []
    for root in (0.1, 0.25, 0.5, 1.0, 1.5):
        depth = root**2 / 5
        found = _force(gfmdlayer.Parabola(radius=5.0), depth) / (16 / 3 * 5**0.5 * depth**1.5)
        both = [np.polynomial.polynomial.polyval(root, each) for each in (_DIMITRIADIS, _GARCIA)]
        cells = [cell for each in both for cell in (f"{each:.3f}", f"{100 * (each / found - 1):+.1f} %")]
        rows.append((f"{root:g}", f"{found:.4f}", *cells))
    yield from _table(("χ", "here", "Dimitriadis", "difference", "Garcia", "difference"), rows)


def film() -> Iterator[str]:
    """Yield the onset of waves of Shenoy and Sharma."""
    yield """\
## Film under attraction

A flat film on a rigid base becomes wavy where the curvature |w″| of the interface exceeds the least stiffness
K(q) of its surface (Shenoy & Sharma, *Phys. Rev. Lett.* 86 (2001) 119, ν = 0.5).
"""
    q = np.linspace(1.5, 3.0, 150_001)
    stiffness = np.asarray(_layer().stiffness(q, 0.0)).real
    least = int(stiffness.argmin())
    found = ("K d/G", "6.22", stiffness[least]), ("q d", "2.12", q[least])
    rows = ((name, *_beside(printed, float(value))) for name, printed, value in found)
    yield from _table(("", "in print", "here", "difference"), rows)


def misprints() -> Iterator[str]:
    """Yield the misprints of the paper."""
    yield """\
## The paper's equations

The comparison of the code with Petrenko et al. (2024) found these misprints:

- ptilde is printed as pbar(2G0): it is pbar/(2 G0).
- Eq. (20), first line: the terms r² lack their squares; the second line is right.
- The kernel 1/|x − x′| of Eq. (7) holds for a surface in two directions; M(q) of Eq. (9) for lines too.

Eqs. (11), (12) and (24) agree with their print to rounding: see [the table](table.md)."""


def rolling() -> Iterator[str]:
    """Yield the rolling viscoelastic cylinders of Wang and Knothe, as CONTACT computes them."""
    yield """\
## Rolling of viscoelastic cylinders

Two equal cylinders roll freely at 1 m/s: 600 N/mm, combined radius 50 mm, ν = 0.4, shear moduli 1143 MPa
(glassy) and 571.5 MPa (relaxed), creep time $\\tau_c$. The case is of Wang & Knothe (1993). The numbers are
the reference output of the program CONTACT (example visc_cylindr, cells of 0.16 mm); the friction is of a
direct solution of the steady state. Both solids deform, so ours is a rigid cylinder on a halfspace of half
the moduli. Its relaxation time is $\\tau_c/2$, its period 1.3 m, and its points are 0.16 mm apart.
"""
    cell = 0.16
    rows = []
    for creep_time, largest, cells, friction in (
        (0.0, "60.32", "80", "0"),
        (0.009, "78.74", "62", "0.0244"),
        (0.045, "84.72", "57", "0.0119"),
        (2.0, "85.31", "56", "0.0005"),
    ):
        law = {"model": "elastic", "G": 285.75}
        if creep_time:
            law = {"model": "zener", "G0": 285.75, "Ginf": 571.5, "tau": creep_time / 2}
        found = gfmdlayer.run(
            {
                "grid": {"points": 8192, "period": 8192 * cell},
                "layer": {"thickness": math.inf, "poisson": 0.4, "material": law},
                "punch": {"shape": "parabola", "radius": 50.0},
                "trajectory": {"control": "force", "force": 600.0, "ramp_time": 0.01, "velocity": 1000.0},
                "time": {"end": 40.0, "step": "adaptive", "tolerance": 1e-3, "steady": 1e-4},
                "output": {"snapshots": [40.0]},
            }
        ).isel(time=-1, snapshot=-1)
        found_cells = f"{float(found.contact_area_interpolated) * 8192:.1f}"
        pressures = _beside(largest, float(found.pressure.max()))
        loss = f"{round(float(found.friction), 5) + 0.0:.5f}"  # no minus before a zero
        rows.append((f"{creep_time:g}", *pressures, cells, found_cells, friction, loss))
    head = (
        r"$\tau_c$ [s]",
        r"$p_\mathrm{max}$ [MPa], CONTACT",
        "here",
        "difference",
        "cells in contact",
        "here",
        "friction",
        "here",
    )
    yield from _table(head, rows)


# Amplitudes fall as |q|^-1.8; phases are multiples of the golden ratio.
_WAVES = ((1, 0), (0, 1), (1, 1), (2, -1), (1, 3), (4, 1), (3, -4), (5, 5))


def rough() -> Iterator[str]:
    """Yield contact of a wavy surface, as Tamaas computes it."""
    yield """\
## A surface of eight waves

h = Σ 0.01 (a² + b²)^(−0.9) cos(2π(a x + b y) + 2π{0.6180339887 i}) on the unit cell. The waves (a, b) are
(1, 0), (0, 1), (1, 1), (2, −1), (1, 3), (4, 1), (3, −4), (5, 5) for i = 1 to 8; braces are fractional parts.
An elastic halfspace with E\\* = 1, 256 × 256 points; peaks touch first. The numbers are of Tamaas 2.9.0
(doi:10.21105/joss.02121) at its tolerance 10⁻¹².
"""
    x, y = np.meshgrid(np.arange(256) / 256, np.arange(256) / 256, indexing="ij")
    heights = sum(
        0.01 * (a * a + b * b) ** -0.9 * np.cos(2 * np.pi * (a * x + b * y + 0.6180339887 * i % 1))
        for i, (a, b) in enumerate(_WAVES, 1)
    )
    rows = []
    for pressure, *printed in (
        (1e-3, "0.03891", "0.0194207", "0.058009"),
        (5e-3, "0.12840", "0.0124930", "0.086706"),
        (2e-2, "0.34322", "0.00290327", "0.124683"),
    ):
        found = gfmdlayer.solve(
            gfmdlayer.halfspace(0.25), heights, mean_pressure=pressure, points=(256, 256), tolerance=1e-10
        )
        ours = found.contact_area, found.gap.mean(), found.pressure.max()
        cells = [_beside(each, float(value)) for each, value in zip(printed, ours, strict=True)]
        rows.append((f"{pressure:g}", *(text for cell in cells for text in cell)))
    columns = [
        text for name in ("area", "mean gap", r"$p_\mathrm{max}$") for text in (name, "here", "difference")
    ]
    yield from _table(("mean pressure", *columns), rows)


def pavements() -> Iterator[str]:
    """Yield deflections of an elastic and of a viscoelastic pavement, as ELLEA1 and ELLVA compute them."""
    yield """\
## A pavement under standing and moving wheels

Layers of 150 and 600 mm on a halfspace, ν = 0.30, 0.35, 0.40, E = 200 and 40 MPa below the first layer; a
pressure of 1.1 MPa on a disc of radius 150 mm. The numbers are results of the codes ELLEA1 and ELLVA, which
come with the code ALVA (validation data of its repository). Elastic, with E = 3000 MPa in the first layer:
"""
    rows = [
        (row.quantity.partition(": ")[2], *_beside(f"{row.theory}", row.found)) for row in pavement(False)
    ]
    yield from _table(("", "ELLEA1", "here", "difference"), rows)
    yield """\
Viscoelastic first layer: $E(t) = E_\\infty (1 + s)/(s + E_\\infty/E_0)$, s = (t/1000 s)^0.35, $E_0$ = 40 GPa,
$E_\\infty$ = 100 MPa. The disc moves along x at 60 km/h. The deflection is 300 mm beside its path, at a
distance x ahead of its middle. We do not know why the codes differ by 1 %:
"""
    printed = {
        2000: "0.271", 1000: "0.447", 500: "0.605", 0: "0.786", -100: "0.790", -500: "0.658", -1000: "0.474",
        -2000: "0.284",
    }  # fmt: skip
    found = _moving_wheel(-np.array(list(printed)))
    rows = [(f"{x}", *_beside(each, u)) for (x, each), u in zip(printed.items(), found, strict=True)]
    yield from _table(("x [mm]", "ELLVA [mm]", "here", "difference"), rows)


def _moving_wheel(x: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    """Return the deflections u(x) = p a/(2 pi) int J_1(q a) int exp(i q.x)/K(q, i q_x v) dangle dq."""
    from scipy.optimize import nnls
    from scipy.special import j1

    times, taus = np.geomspace(1e-8, 1e8, 600), np.geomspace(1e-9, 1e9, 73)
    s = (times / 1000.0) ** 0.35
    modulus = 100.0 * (1 + s) / (s + 100.0 / 4e4)
    series = np.hstack([np.ones((times.size, 1)), np.exp(-times[:, np.newaxis] / taus)])
    relaxed, *branches = nnls(series / modulus[:, np.newaxis], np.ones_like(modulus))[0] / (2 * 1.3)
    pairs = [(G, float(tau)) for G, tau in zip(branches, taus, strict=True) if G > 0]
    stack = gfmdlayer.LayerStack(
        (
            gfmdlayer.Layer(150.0, 0.3, gfmdlayer.Prony(relaxed, pairs)),
            gfmdlayer.Layer(600.0, 0.35, gfmdlayer.Elastic(200 / (2 * 1.35))),
            gfmdlayer.Layer(math.inf, 0.4, gfmdlayer.Elastic(40 / (2 * 1.4))),
        )
    )
    p, a, aside, speed = 1.1, 150.0, 300.0, 60e3 / 3.6
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.concatenate([[0.0], np.geomspace(1e-6, 1e-3, 12), np.linspace(1e-3, 0.1, 100)[1:]])
    half = np.diff(edges)[:, np.newaxis] / 2
    q, weight = (edges[:-1, np.newaxis] + half * (1 + nodes)).ravel(), (half * weights).ravel()
    total = np.zeros(len(x))
    for angle in (np.arange(128) + 0.5) * np.pi / 128:  # the other half circle is its mirror image
        qx, qy = q * math.cos(angle), q * math.sin(angle)
        part = weight * j1(q * a) * np.cos(qy * aside) / stack.stiffness(q, 1j * qx * speed)
        total += (np.exp(1j * np.outer(x, qx)) @ part).real / 128
    return list(p * a * total)


# λ, Maugis' pull-off and ours, of `gfmdlayer verify` of version 0.4.
FINE_GRIDS = (("2", "1.5346", 1.539888), ("3", "1.5168", 1.520804), ("5", "1.5063", 1.508500))


def sphere_with_adhesion() -> Iterator[str]:
    """Yield the pull-off of Maugis; fine grids, which take two minutes, from a run of `gfmdlayer verify`."""
    yield """\
## Pull-off of a sphere, from DMT to JKR

Pull-off force over π w R of a sphere with Dugdale's law, as Maugis' parameter λ grows: Maugis, *J. Colloid
Interface Sci.* 150 (1992) 243. Ours are three-dimensional contacts. Up to λ = 1 they are computed
here; 2, 3 and 5, on up to 1024 × 1024 points, are of a run of `gfmdlayer verify`, which takes two minutes.
"""
    found = [(row.quantity.rpartition("= ")[2], f"{row.theory:g}", row.found) for row in maugis(quick=True)]
    rows = [(each, *_beside(printed, ours)) for each, printed, ours in [*found, *FINE_GRIDS]]
    yield from _table(("λ", "Maugis", "here", "difference"), rows)


def thin_layer_with_adhesion(ratios: Sequence[float] = (4.0, 8.0, 12.0, 16.0)) -> Iterator[str]:
    """Yield the pull-off of a sphere from layers, beside the limits of thin ones."""
    yield """\
## Pull-off of a sphere from a thin layer

Pull-off force over π w R of a rigid sphere on a bonded layer of thickness d; a is the radius of contact at
pull-off. JKR's theory gives 1.5 on a halfspace, a/d = 0. The leading-order
theories of thin layers give limits, a/d = ∞: 2 for a compressible layer (the model of Reedy, *J. Mater. Res.*
21 (2006) 2660), and 3 for an incompressible one (the model of Argatov, Mishuris & Popov, *Q. J. Mech. Appl.
Math.* 69 (2016) 161). The limit here is that of a cubic in d/a through the rows above it; `gfmdlayer verify`
derives the limits and the bound.
"""
    for nu, printed in ((0.3, "2"), (0.5, "3")):
        found = np.array([pull_off(nu, ratio, 1e-3) for ratio in ratios])
        rows = [(f"{1 / thin:.2f}", "", f"{force:.3f}") for thin, force in found]
        limit = np.polynomial.polynomial.polyfit(*found.T, 3)[0]
        rows.append(("∞", printed, f"{limit:.3f}"))
        yield from _table((f"a/d, ν = {nu:g}", "theory", "here"), rows)


SECTIONS: dict[str, tuple[Callable[[], Iterator[str]], str]] = {
    "flat-punch": (flat_punch, "python scripts/published.py flat-punch"),
    "sphere": (sphere, "python scripts/published.py sphere"),
    "film": (film, "python scripts/published.py film"),
    "rolling": (rolling, "python scripts/published.py rolling"),
    "rough": (rough, "python scripts/published.py rough"),
    "pavement": (pavements, "python scripts/published.py pavement"),
    "thin-layer": (thin_layer_with_adhesion, "python scripts/published.py thin-layer"),
    "adhesion": (sphere_with_adhesion, "python scripts/published.py adhesion"),
}


def page() -> str:
    """Return the whole page."""
    parts = [_HEAD]
    for section, command in SECTIONS.values():
        title, *lines = "\n".join(section()).split("\n", 1)
        parts += [f"{title}\n\n```bash\n{command}\n```\n", *lines, ""]
    return "\n".join([*parts, *misprints(), ""])


def main() -> None:
    """Print all tables, or those that are named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("section", nargs="*", help=f"of {', '.join(SECTIONS)} (default: all)")
    for name in parser.parse_args().section or SECTIONS:
        print("\n".join(SECTIONS[name][0]()))


if __name__ == "__main__":
    main()
