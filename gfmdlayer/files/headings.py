"""The meaning of headings: quantities by their names in English, German and French, and their units.

A heading is a name with or without a unit: ``time [ms]``, ``Eindringtiefe (nm)``, ``force in mN``,
``G' / Pa``, ``velocity, um/s``, ``time_ms``. A name may stand for several quantities (delta is a depth or a
phase angle): then the dimension of the unit chooses, then the case of a single letter, then the quantities
that the reader of the file wants. If several remain, the message names them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from typing import NamedTuple

from gfmdlayer.files.units import Unit, unit_of

ANGULAR, ORDINARY = "angular frequency", "frequency"

# Each quantity: a unit of its dimension, and its names. Names are compared in small letters, but single
# letters by their case first.
_QUANTITIES: dict[str, tuple[str, str]] = {
    "time": ("s", "time, t, elapsed time, test time, time stamp, timestamp, zeit, messzeit, prüfzeit, "
        "versuchszeit, laufzeit, zeit gesamt, temps, temps écoulé, durée, time (sequence), total time"),
    "step time": ("s", "step time, interval time, segment time, abschnittszeit, intervallzeit, "
        "temps intervalle, time (action)"),
    ANGULAR: ("rad/s", "omega, ω, w, angular frequency, ang. frequency, ang frequency, ang. freq., "
        "angular freq, angular freq., kreisfrequenz, winkelfrequenz, pulsation, fréquence angulaire"),
    ORDINARY: ("Hz", "f, nu, ν, frequency, freq, freq., hz, frequenz, fréquence, frequence, "
        "test frequency, prüffrequenz"),
    "G'": ("Pa", "g', gp, g stor, g storage, g prime, gprime, "
        "shear storage modulus, storage shear modulus, "
        "shear modulus (elastic component), schubspeichermodul"),
    "G''": ("Pa", "g'', gpp, g loss, g double prime, g dbl prime, gdoubleprime, gprimeprime, "
        "shear loss modulus, loss shear modulus, "
        "shear modulus (viscous component), schubverlustmodul"),
    "|G*|": ("Pa", "g*, |g*|, complex shear modulus, komplexer schubmodul, "
        "shear modulus (complex component)"),
    "E'": ("Pa", "e', ep, e stor, e storage, e prime, eprime, "
        "tensile storage modulus, young's storage modulus"),
    "E''": ("Pa", "e'', epp, e loss, e double prime, e dbl prime, edoubleprime, eprimeprime, "
        "tensile loss modulus, young's loss modulus"),
    "|E*|": ("Pa", "e*, |e*|, complex young's modulus, complex tensile modulus"),
    "storage modulus": ("Pa", "storage modulus, storage, speichermodul, module de stockage, "
        "module de conservation"),
    "loss modulus": ("Pa", "loss modulus, loss, verlustmodul, module de perte, module visqueux"),
    "complex modulus": ("Pa", "complex modulus, dynamic modulus, komplexer modul, module complexe"),
    "tan delta": ("1", "tan delta, tan(delta), tan δ, tan(δ), tan d, tan(d), tand, tandelta, tan_d, "
        "loss factor, loss tangent, damping factor, verlustfaktor, facteur de perte, tan"),
    "G(t)": ("Pa", "g(t), g, g relax, g rel, grel, shear relaxation modulus, shear modulus, "
        "schubmodul, schubrelaxationsmodul"),
    "E(t)": ("Pa", "e(t), e, e relax, e rel, erel, eh, young's relaxation modulus, "
        "tensile relaxation modulus, young's modulus, young, young modulus, youngs modulus, "
        "tensile modulus, elastic modulus, e modulus, e-modulus, e modul, e-modul, elastizitätsmodul, "
        "module d'young"),
    "relaxation modulus": ("Pa", "relaxation modulus, relaxationsmodul, module de relaxation, modulus, "
        "modul, module"),
    "J(t)": ("1/Pa", "j(t), j, shear creep compliance, shear compliance, schubnachgiebigkeit"),
    "D(t)": ("1/Pa", "d(t), tensile creep compliance, tensile compliance"),
    "compliance": ("1/Pa", "creep compliance, compliance, kriechnachgiebigkeit, nachgiebigkeit, "
        "complaisance, complaisance de fluage, kriechkomplianz"),
    "J'": ("1/Pa", "j', jp, j stor, j storage, j prime, shear storage compliance"),
    "J''": ("1/Pa", "j'', jpp, j loss, j double prime, shear loss compliance"),
    "D'": ("1/Pa", "d', tensile storage compliance"),
    "D''": ("1/Pa", "d'', tensile loss compliance"),
    "storage compliance": ("1/Pa", "storage compliance, speichernachgiebigkeit"),
    "loss compliance": ("1/Pa", "loss compliance, verlustnachgiebigkeit"),
    "strain": ("1", "strain, shear strain, oscillation strain, γ, gamma, deformation, dehnung, scherung, "
        "scherdeformation, déformation, déformation de cisaillement"),
    "stress": ("Pa", "stress, shear stress, oscillation stress, τ, σ, sigma, spannung, schubspannung, "
        "contrainte, contrainte de cisaillement"),
    "shear rate": ("1/s", "shear rate, strain rate, scherrate, gradient de cisaillement"),
    "viscosity": ("Pa s", "viscosity, complex viscosity, η, eta, |η*|, viskosität, komplexe viskosität, "
        "betrag(viskosität), viscosité"),
    "phase": ("rad", "phase angle, phase, phasenwinkel, phasenverschiebungswinkel, angle de phase, delta, δ"),
    "temperature": ("K", "temperature, temperatur, température, temp, temp., T, sample temperature, "
        "temperature (sample), probentemperatur"),
    "depth": ("m", "depth, indentation, indentation depth, penetration, penetration depth, d, h, delta, δ, "
        "displacement, disp, disp., eindringtiefe, eindringung, tiefe, verschiebung, weg, prüfweg, "
        "deformation, profondeur, enfoncement, pénétration, profondeur d'indentation, déplacement, "
        "tip depth, tip-sample separation"),
    "base": ("m", "base, height, height (measured), height (piezo), piezo, z piezo, piezo position, "
        "zpiezo, z, cantilever base, piezoweg, z sensor"),
    "deflection": ("m", "deflection, cantilever deflection, cantilever, auslenkung, verbiegung, déflexion, "
        "defl"),
    "force": ("N", "force, normal force, axial force, load, F, f, P, p, vertical force, kraft, "
        "normalkraft, last, prüfkraft, druckkraft, force normale, charge, effort, effort normal"),
    "mean pressure": ("Pa", "mean pressure, pressure, load, p, P, average pressure, nominal pressure, "
        "contact pressure, druck, flächenpressung, mittlerer druck, anpressdruck, pression, "
        "pression moyenne"),
    "velocity": ("m/s", "velocity, v, V, speed, vel, vel., sliding velocity, geschwindigkeit, vitesse"),
    "speed": ("m/s", "speed, slip speed, sliding speed, slip velocity, sliding velocity, velocity, v, V, "
        "vel, vel., geschwindigkeit, gleitgeschwindigkeit, schlupfgeschwindigkeit, vitesse, "
        "vitesse de glissement"),
    "coefficient": ("1", "coefficient, coefficient of friction, friction coefficient, friction, cof, mu, "
        "μ, µ, reibungskoeffizient, reibwert, reibungszahl, reibzahl, coefficient de frottement, frottement"),
    "voltage": ("V", "voltage, bias, U, V, v, potential, bias voltage, spannung, elektrische spannung, "
        "tension"),
    "displacement": ("m", "displacement, tangential displacement, lateral displacement, shift, disp, "
        "disp., x, u, s, sliding distance, verschiebung, weg, gleitweg, tangentialverschiebung, "
        "déplacement, déplacement tangentiel"),
    "tangential force": ("N", "tangential force, lateral force, friction force, shear force, force, Q, F, "
        "T, Ft, Fx, tangentialkraft, reibkraft, reibungskraft, querkraft, kraft, force tangentielle, "
        "force de frottement"),
    "wavenumber": ("1/m", "q, k, wavenumber, wave number, wavevector, wave vector, |q|, wellenzahl, "
        "nombre d'onde"),
    "stiffness": ("Pa/m", "stiffness, K, k(q), surface stiffness, steifigkeit, raideur, rigidité"),
    "radius": ("m", "radius, r, R, distance, x, rayon, abstand"),
    "x": ("m", "x, position, distance, lateral, lateral position, ort, abscisse"),
    "y": ("m", "y"),
    "height": ("m", "height, h, z, y, raw, profile, elevation, höhe, profil, hauteur, altitude"),
    "stiffness of the cantilever": ("N/m", "spring constant, cantilever stiffness, federkonstante"),
}  # fmt: skip
# On a line of the grid forces are per length.
for _name in ("force", "tangential force"):
    _QUANTITIES[f"{_name} per length"] = ("N/m", _QUANTITIES[_name][1])
# Columns of words.
WORDS = {"segment": "segment", "prescribed": "prescribed, control"}
# Quantities of shear and of tension that a heading names without saying which.
BY_MODULUS = {
    "storage modulus": ("G'", "E'"), "loss modulus": ("G''", "E''"), "complex modulus": ("|G*|", "|E*|"),
    "relaxation modulus": ("G(t)", "E(t)"), "compliance": ("J(t)", "D(t)"),
    "storage compliance": ("J'", "D'"), "loss compliance": ("J''", "D''"),
}  # fmt: skip


class Meaning(NamedTuple):
    """What a heading stands for; `reason` is empty where that is certain."""

    options: tuple[str, ...] = ()  # quantities that it may be; none for an unknown name
    unit: Unit | None = None
    symbol: str = ""  # the unit as written
    reason: str = ""

    @property
    def quantity(self) -> str | None:
        """The only option."""
        return self.options[0] if len(self.options) == 1 and not self.reason else None


def dimension_of(quantity: str) -> Unit:
    """Return a unit of the dimension of a quantity."""
    unit = unit_of(_QUANTITIES[quantity][0])
    assert unit is not None
    return unit


def names_of(quantity: str) -> tuple[str, ...]:
    """Return the names of a quantity."""
    return tuple((WORDS.get(quantity) or _QUANTITIES[quantity][1]).split(", "))


def quantities_named(name: str) -> tuple[str, ...]:
    """Return the quantities that a name may stand for, by their own names too."""
    own = (name,) if name in _QUANTITIES else ()
    exact, other = _options(name)
    return tuple(dict.fromkeys((*own, *(each for each in (*exact, *other) if each not in WORDS))))


_TYPED = str.maketrans("′’´`‘”″“", "''''''''")  # primes and quotes; double ones become two below


@cache
def _folded(name: str) -> str:
    """Return a name without case, kinds of primes and kinds of white space."""
    name = re.sub('[”″“"]', "''", name.strip()).translate(_TYPED)
    name = re.sub(r"[\s_]+", " ", name).strip()
    return name.replace("µ", "μ") if len(name) == 1 else name.casefold()


@cache
def _by_name() -> dict[str, tuple[str, ...]]:
    """Return the quantities of each name; single letters have their case."""
    found: dict[str, list[str]] = {}
    for quantity in (*_QUANTITIES, *WORDS):
        for name in names_of(quantity):
            found.setdefault(_folded(name), []).append(quantity)
    return {name: tuple(dict.fromkeys(quantities)) for name, quantities in found.items()}


def _options(name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the quantities of a name: by its case, and by the other case of a single letter."""
    names, folded = _by_name(), _folded(name)
    exact = names.get(folded, ()) or _by_name_and_symbol(name)
    other = names.get(folded.swapcase(), ()) if len(folded) == 1 else ()
    return exact, tuple(each for each in other if each not in exact)


def _by_name_and_symbol(heading: str) -> tuple[str, ...]:
    """Return the quantities of a name with its symbol before or behind it: storage modulus G', Zeit t."""
    words = re.split(r"[\s_]+", heading.strip())
    for symbol, name in ((words[-1], words[:-1]), (words[0], words[1:])):
        if len("".join(name)) < 2 or not re.fullmatch(r"\|?\w\*?\|?(['\"′″’]*|\(t\))", symbol):
            continue
        if unit_of(" ".join(name)):  # f_Hz
            continue
        named = _by_name().get(_folded(" ".join(name)), ())
        meant = {kind for each in named for kind in BY_MODULUS.get(each, (each,))}
        both = tuple(each for options in _options(symbol) for each in options if each in meant)
        unit = unit_of(symbol)  # as in voltage V
        if both and not (unit and any(_fits(each, unit) for each in both)):
            return both
    return ()


# Name and unit of a heading, the surest way of writing first.
_WAYS = (
    r"(.+?)[\s_]*\[([^\[\]]*)\]",
    r"(.+?)[\s_]*\(([^()]*|[^()]*\([^()]*\)[^()]*)\)",
    r"(.+?)[\s_]+in[\s_]+(\S.*)",
    r"(.+?)\s*/\s*\(?(\S.*?)\)?",
    r"(.+?)[\s_]*[,:;][\s_]*(\S.*)",
    r"(.+)[_\s]+(\S+)",
    r"(.+?)[_\s]+(\S.*)",
)  # compiled when first used, as `re` keeps them
_SURE = 4  # ways in which the unit needs not be known


@cache
def split(heading: str) -> tuple[str, str]:
    """Split a heading into its name and its unit, "" without one; an unknown name is returned whole."""
    heading = heading.strip()
    if any(_options(heading)):
        return heading, ""
    for way in _WAYS:
        match = re.fullmatch(way, heading)
        if match and any(_options(match[1])) and (way in _WAYS[:_SURE] or unit_of(match[2])):
            return match[1], match[2].strip(" []()")
    return heading, ""


def unit_in(heading: str) -> str:
    """Return the unit that a heading with any name has in brackets or behind a slash, "" without one."""
    for way in _WAYS[:_SURE]:
        if (match := re.fullmatch(way, heading.strip())) and unit_of(match[2].strip(" []()")) is not None:
            return match[2].strip(" []()")
    return ""


def is_known(heading: str) -> bool:
    """Whether a heading has the name of a quantity."""
    return any(_options(split(heading)[0]))


def meaning(
    heading: str,
    below: str = "",
    wanted: Collection[str] = (),
    units: Mapping[str, str] | Iterable[tuple[str, str]] = (),
    modulus: str | None = None,
) -> Meaning:
    """Return what a heading stands for among the wanted quantities.

    `below` is its cell in a row of units. `units` by quantity or heading, and `modulus`, G for shear or E for
    tension, answer what the heading leaves open.
    """
    name, symbol = split(heading)
    exact, other = _options(name)
    options = (*exact, *other)
    if not options:
        return Meaning()
    below = below.strip(" []()")
    if symbol and below and (own := unit_of(symbol)) and (other_unit := unit_of(below)) and own != other_unit:
        return Meaning((*exact, *other), own, symbol, f"is in {symbol!r}, but the row below says {below!r}")
    symbol = symbol or below
    own = unit_of(symbol) if symbol else None
    frequencies = {ANGULAR, ORDINARY}
    # 1/s, and Hz beside omega, leave open which of the two frequencies it is.
    doubtful = own is not None and frequencies & {*exact} and _frequency(exact, own, symbol)[2]
    for key, answer in dict(units).items():
        named = {*quantities_named(key)}
        by_name = _folded(key) in {_folded(heading), _folded(name)}
        if by_name or named & {*options} or (doubtful and named & frequencies):
            if (given := unit_of(answer)) is None:
                return Meaning(options, None, answer, f"the unit {answer!r} given for it is not known")
            if own is not None and own != given and not doubtful:
                return Meaning(options, None, symbol, f"is in {symbol!r}, but {answer!r} is given for it")
            symbol = answer
            exact = (*exact, ORDINARY) if doubtful and _in_hertz(answer) else exact
    unit = unit_of(symbol) if symbol else None
    if symbol and unit is None:
        return Meaning(options, None, symbol, f"has the unknown unit {symbol!r}")
    if unit is not None and {ANGULAR, ORDINARY} & {*exact}:
        options, unit, reason = _frequency(exact, unit, symbol)
        if reason:
            return Meaning(options, unit, symbol, reason)
    elif unit is not None:
        fitting = tuple(each for each in options if _fits(each, unit))
        if not fitting:
            return Meaning(
                options, unit, symbol, f"is in {symbol!r}, which is no unit of {alternatives(options)}"
            )
        options = tuple(each for each in fitting if each in exact) or fitting
    else:
        options = exact or other
    return _chosen(options, unit, symbol, wanted, modulus)


def _fits(quantity: str, unit: Unit) -> bool:
    return quantity not in WORDS and unit.dimension == dimension_of(quantity).dimension


def _in_hertz(symbol: str) -> bool:
    return re.search(r"hz|hertz", symbol.lower()) is not None


def _frequency(options: tuple[str, ...], unit: Unit, symbol: str) -> tuple[tuple[str, ...], Unit, str]:
    """Tell angular from ordinary frequency by the unit; the reason where it leaves that open."""
    radians, hertz = dimension_of(ANGULAR), dimension_of(ORDINARY)
    if unit.dimension == radians.dimension:
        return (ANGULAR,), unit, ""
    if unit.dimension != hertz.dimension:
        fitting = tuple(each for each in options if _fits(each, unit))
        reason = "" if fitting else f"is in {symbol!r}, which is no unit of {alternatives(options)}"
        return fitting or options, unit, reason
    if (in_hertz := _in_hertz(symbol)) is (ORDINARY in options):
        own = ORDINARY if in_hertz else ANGULAR
        return (own,), unit if in_hertz else unit._replace(dimension=radians.dimension), ""
    reason = f"in {symbol!r} may be a frequency in Hz or an angular frequency in rad/s; say which by its unit"
    return (ANGULAR, ORDINARY), unit, reason


def _chosen(
    options: tuple[str, ...], unit: Unit | None, symbol: str, wanted: Collection[str], modulus: str | None
) -> Meaning:
    """Choose among meanings by what is wanted, and by the word for shear or tension."""
    if kinds := [each for each in options if each in BY_MODULUS]:
        pairs = [BY_MODULUS[each] for each in kinds]
        if modulus is not None:
            options = tuple(pair["GE".index(modulus)] for pair in pairs)
        else:
            options = tuple(each for pair in pairs for each in pair)
    open_still = tuple(each for each in options if each in wanted)
    options = open_still or options
    if len(open_still) > 1:
        which = "in shear (G) or in tension (E)" if kinds else alternatives(options)
        return Meaning(options, unit, symbol, f"may be {which}")
    return Meaning(options if open_still else options[:1], unit, symbol)


def alternatives(words: Iterable[str]) -> str:
    """Join words with commas and a last "or"."""
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last
