r"""Labels of the figures as HTML, and numbers in base64.

Labels are mathtext, "$\tilde{p}/G_0$". HTML needs letters, accents, subscripts and powers only.
"""

from __future__ import annotations

import base64
import math
import re
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_SIGNS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ", "phi": "φ", "psi": "ψ", "omega": "ω", "Delta": "Δ", "infty": "∞", "times": "×",
    "prime": "′",
}  # fmt: skip
_ACCENTS = {"bar": "\u0304", "tilde": "\u0303", "hat": "\u0302", "dot": "\u0307"}
_RAISED = str.maketrans("0123456789-+", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺")

_ACCENT = re.compile(r"\\(bar|tilde|hat|dot)\{([^{}]*)\}")
_UPRIGHT_INDEX = re.compile(r"([_^])\\mathrm\{([^{}]*)\}")
_UPRIGHT = re.compile(r"\\mathrm\{([^{}]*)\}")
_SIGN = re.compile(r"\\([A-Za-z]+) ?")
_INDEX = re.compile(r"([_^])(?:\{([^{}]*)\}|(.))")


def html(label: str) -> str:
    """Write a label, the parts between dollar signs being mathtext, as HTML with subscripts."""
    parts = label.split("$")
    return "".join(_mathtext(part) if i % 2 else escape(part, quote=False) for i, part in enumerate(parts))


def _mathtext(part: str) -> str:
    text = _ACCENT.sub(lambda found: found[2] + _ACCENTS[found[1]], part.replace(r"\,", "\u2009"))
    text = _UPRIGHT.sub(r"\1", _UPRIGHT_INDEX.sub(r"\1{\2}", text))
    text = _SIGN.sub(lambda found: _SIGNS.get(found[1], found[1]), text)
    return _INDEX.sub(_index, escape(text, quote=False)).translate({ord("{"): None, ord("}"): None})


def _index(found: re.Match[str]) -> str:
    """Raise a power in Unicode, which needs no tags, and lower an index by a tag."""
    inner = found[2] or found[3]
    if found[1] == "_":
        return f"<sub>{inner}</sub>"
    return inner.translate(_RAISED) if re.fullmatch(r"[-+0-9]+", inner) else f"<sup>{inner}</sup>"


def packed(values: ArrayLike) -> str:
    """Return numbers as base64 of single precision, little-endian: seven digits."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")


def plain(value: Any) -> Any:
    """Return an attribute as JSON has it: a number, or text; None for what is not a number."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.ndarray):
        return ", ".join(str(plain(each)) for each in value.ravel().tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value if isinstance(value, int | float | str) else str(value)
