"""The page of published values beside those of this code, which are computed while the site is built."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import gfmdlayer

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.config import Config as Settings

_HEAD = """\
# Published values beside ours

Printed tables are a good test, and some of them have wrong digits. The build of this page computes the
columns "here" with `gfmdlayer.indent` and the stiffness K(q). A difference beyond the last printed digit
is in **bold**.

"""
# Hayes, Keer, Herrmann & Mockros, J. Biomech. 5 (1972) 541, Table 1, Poisson's ratio 0.5: a/h and kappa.
_HAYES = {
    0.2: "1.281", 0.4: "1.683", 0.6: "2.211", 0.8: "2.855", 1.0: "3.609", 1.5: "5.970", 2.0: "9.069",
    2.5: "13.00", 3.0: "17.86", 3.5: "23.74", 4.0: "30.75",
}  # fmt: skip
_DIMITRIADIS = (1.0, 1.133, 1.283, 0.769, 0.0975)
_GARCIA = (1.0, 1.133, 1.497, 1.469, 0.755)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page before the sources are read."""
    app.connect("config-inited", _write)
    return {"parallel_read_safe": True}


def _write(app: Sphinx, _settings: Settings) -> None:
    path = Path(app.srcdir) / "verification/published.md"
    parts = _flat_punch(), _sphere(), _film(), _slips()
    text = _HEAD + "\n".join(line for part in parts for line in part) + "\n"
    if not path.exists() or path.read_text(encoding="utf-8") != text:  # an equal page is not read again
        path.write_text(text, encoding="utf-8")


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


def _flat_punch() -> Iterator[str]:
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


def _sphere() -> Iterator[str]:
    yield """\
## Sphere on a bonded incompressible layer

Force over that of Hertz, a function of χ = √(Rδ)/h, by two polynomials in χ: Dimitriadis et al.,
*Biophys. J.* 82 (2002) 2798, and Garcia & Garcia, *Biophys. J.* 114 (2018) 2923. [Force curves of
indenters](../theory/indentation.md) has the effect of these errors on fits.
"""
    rows = []
    for root in (0.1, 0.25, 0.5, 1.0, 1.5):
        depth = root**2 / 5
        found = _force(gfmdlayer.Parabola(radius=5.0), depth) / (16 / 3 * 5**0.5 * depth**1.5)
        both = [np.polynomial.polynomial.polyval(root, each) for each in (_DIMITRIADIS, _GARCIA)]
        cells = [cell for each in both for cell in (f"{each:.3f}", f"{100 * (each / found - 1):+.1f} %")]
        rows.append((f"{root:g}", f"{found:.4f}", *cells))
    yield from _table(("χ", "here", "Dimitriadis", "difference", "Garcia", "difference"), rows)


def _film() -> Iterator[str]:
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


def _slips() -> Iterator[str]:
    yield """\
## The paper's equations

The comparison of the code with Petrenko et al. (2024) found these misprints:

- ptilde is printed as pbar(2G0): it is pbar/(2 G0).
- Eq. (20), first line: the terms r² lack their squares; the second line is right.
- The kernel 1/|x − x′| of Eq. (7) holds for a surface in two directions; M(q) of Eq. (9) for lines too.

Eqs. (11), (12) and (24) agree with their print to rounding: see [the table](table.md)."""
