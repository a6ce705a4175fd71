"""Calls that a user plausibly gets wrong: each error names the argument, what came, and what is allowed."""
# ruff: noqa: E501 - a table

import numpy as np
import pytest

import gfmdlayer as g

HALF, BALL = g.halfspace(1.0), g.Parabola(radius=1.0)
SHORT = {"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 64}}
DEPTH = np.linspace(0.0, 0.1, 30)
CURVE = g.ForceCurve("a", DEPTH, DEPTH, DEPTH**1.5)
MODEL = {"body": HALF, "punch": BALL}
FREE = "layer.material.G"
RAMP = [0, 1], [0, 0.01]


class Foam:
    """A body of a class of the user's own, which is no `Solid`."""

    @property
    def mean_stiffness(self):
        return 1.0

    def stiffness(self, waves, s):
        return np.asarray(waves) * s

    def spectrum(self, waves):  # noqa: ARG002
        return None


# Call, then words of the message: the argument and what came; what is allowed.
WRONG = {
    # runs
    "body of another class": (lambda: g.run(SHORT, body=Foam()), "body: got Foam", "a class of your own derives from Solid"),
    "body as a word": (lambda: g.run(SHORT, body="rubber"), "body: got str", "must be a body such as halfspace"),
    "two bodies": (lambda: g.Config(name="a", layer={}, body=HALF), "body: given beside layer", "remove one of the two"),
    "punch as a number": (lambda: g.run(SHORT, punch=5.0), "punch: ", "must be 64, as the grid"),
    "punch as a word": (lambda: g.run(SHORT, punch="sphere"), "punch: got the text 'sphere'", "{shape: sphere, radius: ...}"),
    "key of a section alone": (lambda: g.run(SHORT, radius=2.0), "radius: unknown key", "did you mean 'punch.radius'"),
    "misspelt key": (lambda: g.run(SHORT, layer__thicknes=0.1), "layer.thicknes: unknown key", "did you mean 'thickness'"),
    "section as a number": (lambda: g.run(SHORT, layer=0.1), "layer: got 0.1", "must be a mapping"),
    "law as a number": (lambda: g.run(SHORT, interface=0.1), "interface: got 0.1", "{law: exponential, work: ..., range: ...}"),
    "history of one column": (lambda: g.run(SHORT, history=[1, 2, 3]), "history: got an array of 3", "must be (m, 2), or a pair"),
    "sweep as a list": (lambda: g.run(SHORT, sweep=[0.1, 0.2]), "sweep: got [0.1, 0.2]", "must be a mapping"),
    "no jobs": (lambda: g.run(SHORT, jobs=0), "jobs: got 0", "must be a whole number >= 1"),
    "jobs as a word": (lambda: g.run(SHORT, jobs="all"), "jobs: got the text 'all'", "must be a whole number >= 1"),
    "no threads": (lambda: g.run(SHORT, threads=0), "threads: got 0", "must be a whole number >= 1"),
    "progress as a word": (lambda: g.run(SHORT, progress="yes"), "progress: got the text 'yes'", "must be True, False or None"),
    "out as a number": (lambda: g.run(SHORT, out=5), "out: got 5", "must be the name of a folder"),
    "no configuration": (lambda: g.run(None), "config: got NoneType", "must be a path, a mapping or a Config"),
    "no file": (lambda: g.run("nothing.yaml"), "nothing.yaml:1:1: cannot be read", "must be the name of a YAML file"),
    "path as a number": (lambda: g.load(5), "path: got 5", "must be the name of a YAML file"),
    "keys without names": (lambda: g.Config(5), "Config: got 1 value without a name", "takes name, units, grid"),
    "goal of converge": (lambda: g.converge(SHORT, goal=0.01), "goal: unknown key", "allowed: name, units"),
    # one contact
    "no load": (lambda: g.solve(HALF, BALL), "solve: got nothing", "must be one of depth, mean_pressure and force"),
    "two loads": (lambda: g.solve(HALF, BALL, depth=0.1, force=1.0), "solve: got depth and force", "must be one of"),
    "load": (lambda: g.solve(HALF, BALL, load=0.1), "load: unknown argument", "solve takes body, punch, depth, mean_pressure"),
    "pressure": (lambda: g.solve(HALF, BALL, pressure=0.1), "pressure: unknown argument", "did you mean 'mean_pressure'"),
    "depth as a word": (lambda: g.solve(HALF, BALL, depth="deep"), "depth: got the text 'deep'", "must be a number >= 0"),
    "depth by its place": (lambda: g.solve(HALF, BALL, 0.1), "solve: got 3 arguments without a name", "takes body, punch in this order"),
    "no punch": (lambda: g.solve(HALF, depth=0.1), "punch: missing", "solve takes body, punch, depth"),
    "the wrong order": (lambda: g.solve(BALL, HALF, depth=0.1), "body: Parabola has no mean_stiffness", "must be a body, such as halfspace"),
    "body as a number": (lambda: g.solve(1.0, BALL, depth=0.1), "body: float has no mean_stiffness", "must be a body, such as halfspace"),
    "a key of no body": (lambda: g.solve({"layr": {}}, BALL, depth=0.1), "body: layr: unknown key", "did you mean 'layer'"),
    "punch as a radius": (lambda: g.solve(HALF, 5.0, depth=0.1), "punch: got 5.0", "a shape such as Sphere(radius=1.0)"),
    "no surface file": (lambda: g.solve(HALF, "sphere", depth=0.1), "punch: got the text 'sphere'", "Sphere(radius=1.0)"),
    "misspelt shape": (lambda: g.solve(HALF, {"shape": "ball"}, depth=0.1), "punch.shape: got the text 'ball'", "must be one of parabola, sphere"),
    "misspelt key of a shape": (lambda: g.solve(HALF, {"shape": "sphere", "R": 1.0}, depth=0.1), "punch.R: unknown key", "allowed: shape, radius"),
    "heights in three directions": (lambda: g.solve(HALF, np.zeros((8, 8, 8)), depth=0.1), "punch: got an array of 3 dimensions", "must be heights"),
    "heights that are no numbers": (lambda: g.solve(HALF, np.full(64, np.nan), depth=0.1), "punch: the height at index [0]", "not a finite number"),
    "too few points": (lambda: g.solve(HALF, BALL, depth=0.01, points=7), "points: got 7", "must be a whole number >= 8"),
    "negative period": (lambda: g.solve(HALF, BALL, depth=0.01, period=-1), "period: got -1", "must be a number > 0"),
    "method of a textbook": (lambda: g.solve(HALF, BALL, depth=0.01, method="fft"), "method: got the text 'fft'", "must be one of auto, active_set"),
    "friction as a word": (lambda: g.solve(HALF, BALL, depth=0.01, friction="high"), "friction.coefficient: got the text 'high'", "must be a number >= 0"),
    "shear without friction": (lambda: g.solve(HALF, BALL, depth=0.01, tangential_force=1.0), "tangential_force: only with friction", "remove it"),
    "interface as a number": (lambda: g.solve(HALF, BALL, depth=0.01, interface=0.1), "interface: got 0.1", "must be a law such as Exponential"),
    "previous as a number": (lambda: g.solve(HALF, BALL, depth=0.01, friction=0.1, previous=5), "previous: got 5", "must be a result of solve with friction"),
    "a liquid at rest": (lambda: g.solve(g.halfspace(g.PowerLaw()), BALL, depth=0.01), "body: the relaxed modulus of PowerLaw is 0", "give instantaneous=True"),
    "a lattice with friction": (lambda: g.solve(g.Pair(HALF, g.Lattice(crystal="simple_cubic", nearest=1.0, spacing=1 / 64)), BALL, depth=0.01, friction=0.1, points=64),
                                "body: Lattice has no response to shear", "must be a halfspace or layers"),
    # indentation
    "no history": (lambda: g.indent(HALF, BALL, [0, 1]), "depth, force: got neither", "must be one of the two"),
    "energy of adhesion": (lambda: g.indent(HALF, BALL, [0, 1], depth=[0, 0.01], energy=0.1), "energy: unknown argument", "indent takes body, punch, time"),
    "work as a word": (lambda: g.indent(HALF, BALL, [0, 1], depth=[0, 0.01], work="x"), "work: got 'x'", "must be a number"),
    "indenter as a radius": (lambda: g.indent(HALF, 5.0, [0, 1], depth=[0, 0.01]), "punch: got 5.0", "Sphere(radius=1.0), its keys"),
    "unequal lengths": (lambda: g.indent(HALF, BALL, [0, 1], depth=[0, 0.01, 0.02]), "depth: got shape (3,)", "must be equal"),
    "times backwards": (lambda: g.indent(HALF, BALL, [1, 0], depth=[0, 0.01]), "time: got 0 after 1", "must ascend"),
    "times as words": (lambda: g.indent(HALF, BALL, ["a", "b"], depth=[0, 0.01]), "time: got [the text 'a', the text 'b']", "must be numbers"),
    "all snapshots": (lambda: g.indent(HALF, BALL, [0, 1], depth=[0, 0.01], snapshots="all"), "snapshots: got the text 'all'", "must be numbers"),
    "no tolerance": (lambda: g.indent(HALF, BALL, [0, 1], depth=[0, 0.01], tolerance=0), "tolerance: got 0", "must be finite and >= 1e-09"),
    # bodies, materials, punches, interfaces
    "radius without a name": (lambda: g.Sphere(5.0), "Sphere: got 1 value without a name", "such as Sphere(radius=5.0)"),
    "R": (lambda: g.Sphere(R=5.0), "R: unknown key", "allowed: shape, radius"),
    "radius with a unit": (lambda: g.Sphere(radius="5 um"), "radius: got the text '5 um'", "a section by itself has no units"),
    "modulus E": (lambda: g.Elastic(E=1.0), "E: unknown key", "allowed: model, moduli, shift, young, bulk, G"),
    "too many moduli": (lambda: g.Zener(1.0, 2.0, 3.0, 4.0), "Zener: got 4 values without a name", "takes G0, Ginf, tau in this order"),
    "Ginf below G0": (lambda: g.Zener(G0=2.0, Ginf=1.0), "Ginf: got 1.0, below G0 = 2.0", "must be a number >= G0"),
    "branches without times": (lambda: g.Prony(1.0, [1.0]), "branches[0]: got 1.0", "{G: ..., tau: ...}"),
    "branch alone": (lambda: g.Prony(1.0, 2.0), "branches: got 2.0", "must be a list"),
    "material as a number": (lambda: g.LayerStack([g.Layer(0.1, 0.5, 1.0)]), "material: got 1.0", "such as Elastic(1.0)"),
    "a stack of one": (lambda: g.LayerStack(g.Layer()), "layers: got an object of the type Layer", "must be a list of Layer"),
    "material as a word": (lambda: g.halfspace("rubber"), "material: got the text 'rubber'", "must be a law of a material"),
    "nu": (lambda: g.halfspace(1.0, nu=0.5), "nu: unknown argument", "halfspace takes material, G, young, poisson"),
    "two moduli": (lambda: g.halfspace(1.0, young=3.0), "material: got material and young", "must be one of material, G and young"),
    "no material": (lambda: g.bonded_layer(0.1), "material: missing", "must be one of material, G and young"),
    "a pair of a number": (lambda: g.Pair(HALF, 1.0), "second: float has no mean_stiffness", "must be a body, such as halfspace"),
    "work without a name": (lambda: g.Exponential(1e-3, 4e-3), "Exponential: got 2 values", "Exponential(work=0.001, range=0.004)"),
    "energy": (lambda: g.Dugdale(energy=1.0), "energy: unknown key", "allowed: law, work, stress, smoothing"),
    "constants of a shift": (lambda: g.WLF(1, 2), "WLF: got 2 values without a name", "takes reference, C1, C2 by name"),
    # fits
    "body as a model": (lambda: g.fit_indentation(CURVE, HALF, "G"), "model: got an object of the type ViscoelasticLayer", "must be a mapping of a body and a punch"),
    "free as a number": (lambda: g.fit_indentation(CURVE, MODEL, 5), "free: got 5", "name at least one parameter"),
    "another modulus": (lambda: g.fit_indentation(CURVE, MODEL, "layer.material.H"), "free: layer.material.H: unknown key", "did you mean 'layer.material.G'"),
    "bounds as a number": (lambda: g.fit_indentation(CURVE, MODEL, {FREE: 5.0}), f"free: {FREE}: got 5.0", "give two finite numbers"),
    "one depth": (lambda: g.fit_indentation(CURVE, MODEL, FREE, range=5.0), "range: got 5.0", "must be two depths, the lower one first"),
    "stiffness as a word": (lambda: g.fit_indentation(CURVE, MODEL, FREE, stiffness="soft"), "stiffness: got 'soft'", "must be > 0 and finite"),
    "SI": (lambda: g.fit_indentation(CURVE, MODEL, FREE, units="SI"), "units: got 'SI'", "such as ('s', 'nm', 'nN')"),
    "another contact": (lambda: g.fit_map(CURVE, MODEL, FREE, contact="auto"), "contact: got 'auto'", "must be one of given, detect"),
    "segments as numbers": (lambda: g.fit_indentation(CURVE, MODEL, FREE, segments=[1]), "segments: got [1]", "must be names"),
    "noise as a word": (lambda: g.ForceCurve("a", DEPTH, DEPTH, DEPTH**1.5, noise="low"), "curve a: noise = 'low'", "must be > 0 and finite, or None"),
    "a number as curves": (lambda: g.fit_indentation(5.0, MODEL, FREE), "curves: got float", "a ForceCurve, a path"),
    "no curves": (lambda: g.fit_map([], MODEL, FREE), "got no curve", "give at least one"),
    "no jobs of a map": (lambda: g.fit_map(CURVE, MODEL, FREE, jobs=0), "jobs: got 0", "must be a whole number >= 1"),
    "a number as data": (lambda: g.fit_material(5.0), "data: got 5.0", "must be a path"),
    # results
    "leakage of a number": (lambda: g.leakage(5), "data: got 5", "must be an xarray.Dataset"),
    "inside nothing": (lambda: g.inside(None, [0.1]), "data: got nothing", "must be an xarray.Dataset"),
    "results that are not there": (lambda: g.open_results("nothing"), "nothing: no such folder", "no such folder"),
    "a picture of a number": (lambda: g.plot(5), "data: got 5", "must be data of run, solve or indent"),
    "another picture": (lambda: g.plot(g.solve(HALF, BALL, depth=1e-3), "snapshot"), "kind: got the text 'snapshot'", "did you mean 'snapshots'"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_call_is_refused_in_words(case):
    call, came, allowed = WRONG[case]
    with pytest.raises(g.GfmdlayerError) as caught:
        call()
    assert came in str(caught.value)
    assert allowed in str(caught.value)


def test_one_word_stands_for_a_list_of_one():
    fit = g.fit_indentation(CURVE, MODEL, FREE)
    assert fit[FREE].value == g.fit_indentation(CURVE, MODEL, [FREE])[FREE].value
    approach = g.ForceCurve("a", DEPTH, DEPTH, DEPTH**1.5, segment="approach")
    assert g.fit_indentation(approach, MODEL, FREE, segments="approach").rows == DEPTH.size


def test_a_misspelt_name_has_a_hint():
    with pytest.raises(AttributeError, match="did you mean 'fit_indentation'"):
        g.fit_Indentation  # noqa: B018
