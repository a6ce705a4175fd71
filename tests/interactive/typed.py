"""A script as a user writes it. `mypy --strict` reads it as it stands, and a test runs it."""
# ruff: noqa: T201

from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import gfmdlayer
from gfmdlayer import ForceCurve, GfmdlayerError, Layer, LayerStack, Sphere, Zener

RUBBER = Zener(G0=1.0, Ginf=10.0, tau=1.0)


def bodies() -> dict[str, LayerStack | gfmdlayer.ViscoelasticLayer]:
    """Return a coating, two coats, and a halfspace."""
    return {
        "coating": gfmdlayer.bonded_layer(0.1, RUBBER, halfspace=2.0),
        "two coats": LayerStack([Layer(0.05, 0.4, RUBBER), Layer(0.1, 0.5)], rigid=True),
        "halfspace": gfmdlayer.halfspace(young=3.0),
    }


def areas(loads: list[float]) -> dict[str, NDArray[np.float64]]:
    """Return contact areas over loads."""
    found = {}
    for name, body in bodies().items():
        contact = gfmdlayer.solve(body, Sphere(radius=2.0), force=loads, points=(32, 32))
        found[name] = np.asarray(contact["contact_area"].values, dtype=float)
    return found


def loop(thickness: float) -> xr.Dataset:
    """Return a short run."""
    keys = {"grid": {"points": 128}, "time": {"end": 1.0}}
    return gfmdlayer.run(keys, punch=Sphere(radius=2.0), layer__thickness=thickness)


def modulus(time: NDArray[np.float64]) -> float:
    """Return the modulus that a fit finds again."""
    depth = 0.01 * time
    ball = Sphere(radius=2.0)
    force = gfmdlayer.indent(gfmdlayer.halfspace(2.0), ball, time, depth=depth)["force"].interp(time=time)
    model = {"body": gfmdlayer.halfspace(1.0), "punch": ball}
    fit = gfmdlayer.fit_indentation(ForceCurve("ramp", time, depth, force.values), model, "layer.material.G")
    return float(fit["G"].value)


def main(folder: Path) -> None:
    """Write the pictures and tables."""
    print({name: found.round(4).tolist() for name, found in areas([1e-3, 2e-3]).items()})
    data = loop(0.2)
    gfmdlayer.plot(data, y="contact_area", out=folder / "loop.png")
    print(round(modulus(np.linspace(0.0, 1.0, 40)), 3))
    try:
        loop(-1.0)
    except GfmdlayerError as error:
        print(error)


if __name__ == "__main__":
    main(Path.cwd())
