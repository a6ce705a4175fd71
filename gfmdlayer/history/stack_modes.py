"""Stacks whose layers have reduced times of their own: temperature with different shifts.

The internal vector xi of `body.network` is the state. In a step the reduced time of each layer elapses
(`reduced_time`), and their ratios are taken as constant over it; u is linear in them. With tau from 0 to 1
and x_j = (reduced time that elapses in the layer of element j)/theta_j,

    d(xi)/dtau = X (B^T g u - (1 + B^T B) xi),        X = diag(x).

The modes of the step would be the eigenvectors of X (1 + B^T B), which differ from step to step. Instead the
two functions of a mode are sums over poles s_p in pairs, of which the real part counts,

    (1 - exp(-x))/x = sum_p rho_p/(x + s_p),        exp(-x) = 1 - x sum_p rho_p/(x + s_p),

with an error of 3e-12 for all x >= 0 and 7 pairs. A function of X (1 + B^T B) then needs one linear system
for each pole, of the size of the redundant springs. B has the columns P_a c_j for the elements j of the
spring a. With e = g u - B xi, and xi, e before the step and du = u_1 - u_0:

    E_pj = x_j/(x_j + s_p),           z_pa = sum_(j in a) c_j E_pj xi_j
    C_p = P diag_a(sum_(j in a) c_j^2 E_pj) P^T
    gamma_p = (1 + C_p)^-1 g,         h_p = (1 + C_p)^-1 (e + P z_p)
    kappa = g . sum_p (rho_p/s_p) gamma_p,        b = kappa u_0 - g . sum_p rho_p h_p
    w_p = rho_p [h_p + gamma_p (du/s_p + c (2/s_p^2 - 1/s_p))]
    xi_j <- xi_j (1 - sum_p rho_p E_pj) + c_j sum_p E_pj (P^T w_p)_a(j),        e <- sum_p w_p
    work = sum_p g . w_p [du/s_p + c (1/s_p - 2/s_p^2)],                        heat = work - change of energy

with c = dt^2 u''/2. The residues satisfy sum rho = 1, sum rho/s = 1 and sum rho/s^2 = 1/2, so that e stays
g u - B xi. kappa is a quadrature of K(q, s)/s^2 over the poles: nothing of the size of the glassy stiffness
is subtracted. In the modes of the step, which are never found, the decay lies in [-1, 1] and the heat is a
positive quadratic form: the step is stable, and heat is not negative. Backward Euler is the pole s = rho = 1.

Where the layers have the same shift these are the modes in reduced time, and at constant temperature those of
the stack of shifted times. While the ratios of the reduced times change, the error of a step is of third
order in its length, like the error of taking u as linear over it. For steps of varying length the error of
the ratios is estimated from two halves of the step, 4/3 of the difference between them and the whole; the
history is corrected by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gfmdlayer.arrays import ComplexArray, FloatArray, IntArray
from gfmdlayer.body.network import InternalVariables
from gfmdlayer.grid.sums import Sums
from gfmdlayer.history.modes import RELEVANT, Modes, Scheme, exponential
from gfmdlayer.history.reduced_time import ReducedTime
from gfmdlayer.kernels import kernel

# Upper half plane of the 14 poles of the best rational approximation of exp(-x) on [0, inf), by Caratheodory
# and Fejer (Trefethen, Weideman & Schmelzer, BIT 46 (2006) 653), and residues that fit (1 - exp(-x))/x in the
# largest error, weighted with 1 + x, under the three conditions.
_POLES: ComplexArray = np.array(
    [
        5.62317153474907 + 1.1940664287035054j,
        5.089374564868055 + 3.5888160956106345j,
        3.993400429645279 + 6.004818060147936j,
        2.269816525848304 + 8.461717806887696j,
        -0.20872377765454347 + 10.991232026342253j,
        -3.7032391601860652 + 13.656333463723643j,
        -8.897735413193399 + 16.63093520843589j,
    ]
)
_RESIDUES: ComplexArray = np.array(
    [
        8.434531016213073 + 16.37485769192079j,
        -10.383321467998769 - 1.6467057195222834j,
        2.475105594316362 - 2.2673287326221834j,
        0.003482833437697508 + 0.5690505445732594j,
        -0.031136283080995364 - 0.033650877673193635j,
        0.0013468120638419068 + 0.00032590468416060503j,
        -8.504951211962819e-06 + 2.4966695066908073e-07j,
    ]
)

# Relative difference up to which ratios of reduced times are the same: rounding of the times.
_SAME = 1e-12


class Quadrature(NamedTuple):
    """Poles of a scheme, with residues of which the real part of the sum counts."""

    poles: ComplexArray  # s
    residues: ComplexArray  # rho, doubled where the conjugate is left out
    curved: ComplexArray  # 2/s^2 - 1/s; zero where the scheme takes u as linear


EXPONENTIAL = Quadrature(_POLES, 2 * _RESIDUES, 2 / _POLES**2 - 1 / _POLES)
_BACKWARD_EULER = Quadrature(*np.array([[1.0], [1.0], [0.0]], dtype=np.complex128))


class Elements(NamedTuple):
    """The network of each wavenumber, and the positions on the grid that have it."""

    force: FloatArray  # g, (waves, redundant)
    projection: FloatArray  # P, (waves, redundant, springs)
    first: IntArray  # (springs + 1,): the elements of spring a are first[a] ... first[a + 1] - 1
    roots: FloatArray  # c, (elements,)
    edges: IntArray  # (waves + 1,): the positions of wave k are edges[k] ... edges[k + 1] - 1


class NetworkFactors(NamedTuple):
    """Factors of a step, the same at all wavenumbers."""

    x: FloatArray  # (elements,)
    decay: FloatArray  # (elements,), 1 - sum_p rho_p E_pj
    table: FloatArray  # (elements, 2 poles): c_j E_pj, the real parts before the imaginary ones
    compliance: ComplexArray  # (springs, poles), sum_(j in a) c_j^2 E_pj


class Solved(NamedTuple):
    """The linear systems of a step; parts are the real and the imaginary one of a spectrum."""

    kappa: FloatArray  # (waves,)
    intercept: FloatArray  # (positions, 2)
    gamma: ComplexArray  # (waves, poles, redundant)
    h: ComplexArray  # (positions, 2, poles, redundant)


@kernel(reorder=True)
def solve_step(
    elements: Elements,
    factors: NetworkFactors,
    rule: Quadrature,
    xi: FloatArray,
    u: FloatArray,
    solved: Solved,
) -> None:
    """Solve the linear systems of a step that begins with xi and u."""
    waves, redundant, springs = elements.projection.shape
    poles = rule.poles.size
    lower = np.empty((poles, redundant, redundant), dtype=np.complex128)
    sums = np.empty((springs, 2 * poles))
    e, y = np.empty(redundant), np.empty(redundant, dtype=np.complex128)
    for k in range(waves):
        P, g, kappa = elements.projection[k], elements.force[k], 0.0
        for p in range(poles):
            _factorize(P, factors.compliance[:, p], lower[p])
            y[:] = g
            _substitute(lower[p], y)
            solved.gamma[k, p] = y
            for i in range(redundant):
                kappa += (rule.residues[p] / rule.poles[p] * y[i]).real * g[i]
        solved.kappa[k] = kappa
        for n in range(elements.edges[k], elements.edges[k + 1]):
            for part in range(2):
                _elongate(elements, k, xi[n, :, part], u[n, part], e)
                _weigh(elements, factors.table, xi[n, :, part], sums)
                intercept = kappa * u[n, part]
                for p in range(poles):
                    for i in range(redundant):
                        y[i] = e[i]
                        for a in range(springs):
                            y[i] += P[i, a] * complex(sums[a, p], sums[a, poles + p])
                    _substitute(lower[p], y)
                    solved.h[n, part, p] = y
                    for i in range(redundant):
                        intercept -= (rule.residues[p] * y[i]).real * g[i]
                solved.intercept[n, part] = intercept


@kernel(reorder=True, inner=True)
def _factorize(projection: FloatArray, compliance: ComplexArray, lower: ComplexArray) -> None:
    """Set L, with D on its diagonal, so that 1 + P diag(compliance) P^T = L D L^T; it is never singular."""
    P, L = projection, lower
    for i in range(len(P)):
        for j in range(i + 1):
            value = complex(1.0 if i == j else 0.0)
            for a in range(compliance.size):
                value += P[i, a] * P[j, a] * compliance[a]
            for m in range(j):
                value -= L[i, m] * L[j, m] * L[m, m]
            L[i, j] = value if i == j else value / L[j, j]


@kernel(reorder=True, inner=True)
def _substitute(lower: ComplexArray, y: ComplexArray) -> None:
    """Replace y by the solution x of L D L^T x = y."""
    for i in range(y.size):
        for m in range(i):
            y[i] -= lower[i, m] * y[m]
    for i in range(y.size - 1, -1, -1):
        y[i] /= lower[i, i]
        for m in range(i + 1, y.size):
            y[i] -= lower[m, i] * y[m]


@kernel(reorder=True, inner=True)
def _elongate(elements: Elements, k: int, xi: FloatArray, u: float, e: FloatArray) -> None:
    """Set e to g u - B xi at the wave k."""
    g, P = elements.force[k], elements.projection[k]
    for i in range(e.size):
        e[i] = g[i] * u
    for a in range(P.shape[1]):
        strain = 0.0
        for j in range(elements.first[a], elements.first[a + 1]):
            strain += elements.roots[j] * xi[j]
        for i in range(e.size):
            e[i] -= P[i, a] * strain


@kernel(reorder=True, inner=True)
def _weigh(elements: Elements, table: FloatArray, xi: FloatArray, sums: FloatArray) -> None:
    """Set the sums over the elements of each spring of c_j E_pj xi_j, (springs, 2 poles)."""
    sums[:] = 0.0
    for a in range(len(sums)):
        for j in range(elements.first[a], elements.first[a + 1]):
            for m in range(sums.shape[1]):
                sums[a, m] += table[j, m] * xi[j]


@kernel(reorder=True)
def advance_step(
    elements: Elements,
    factors: NetworkFactors,
    rule: Quadrature,
    solved: Solved,
    moved: FloatArray,
    curvature: FloatArray,
    xi: FloatArray,
    work: FloatArray,
) -> None:
    """Advance xi by a step in which u moves by `moved`; set the work on the network, (positions,)."""
    # `curvature` is dt^2 u''/2, (positions, 2), or empty where u is linear.
    waves, redundant, springs = elements.projection.shape
    poles = rule.poles.size
    drive = np.empty((springs, 2 * poles))
    for k in range(waves):
        P, g = elements.projection[k], elements.force[k]
        for n in range(elements.edges[k], elements.edges[k + 1]):
            done = 0.0
            for part in range(2):
                du, c = moved[n, part], curvature[n, part] if curvature.size else 0.0
                drive[:] = 0.0
                for p in range(poles):
                    by_gamma = du / rule.poles[p] + c * rule.curved[p]
                    path = du / rule.poles[p] - c * rule.curved[p]
                    for i in range(redundant):
                        w = rule.residues[p] * (solved.h[n, part, p, i] + solved.gamma[k, p, i] * by_gamma)
                        done += g[i] * (w * path).real
                        for a in range(springs):
                            drive[a, p] += P[i, a] * w.real
                            drive[a, poles + p] -= P[i, a] * w.imag
                for a in range(springs):
                    for j in range(elements.first[a], elements.first[a + 1]):
                        value = factors.decay[j] * xi[n, j, part]
                        for m in range(2 * poles):
                            value += factors.table[j, m] * drive[a, m]
                        xi[n, j, part] = value
            work[n] = done


@kernel(reorder=True)
def network_energy(elements: Elements, xi: FloatArray, u: FloatArray, energy: FloatArray) -> None:
    """Set the energy (|g u - B xi|^2 + |xi|^2)/2 of the network, (positions,)."""
    e = np.empty(elements.force.shape[1])
    for k in range(len(elements.force)):
        for n in range(elements.edges[k], elements.edges[k + 1]):
            twice = 0.0
            for part in range(2):
                _elongate(elements, k, xi[n, :, part], u[n, part], e)
                for i in range(e.size):
                    twice += e[i] * e[i]
                for j in range(xi.shape[1]):
                    twice += xi[n, j, part] * xi[n, j, part]
            energy[n] = twice / 2


class StackModes(Modes):
    """A stack whose layers have reduced times of their own: modes of the uppermost layer, and a network."""

    KEPT = (*Modes.KEPT, "xi", "time")

    def __init__(
        self,
        internal: InternalVariables,
        scheme: Scheme,
        sums: Sums,
        *,
        reduced_times: Sequence[ReducedTime | None],
        halved: bool = False,
    ) -> None:
        # `reduced_times` has one for each law of the body, None where the times do not change; elastic layers
        # below need none. `halved`: each step is corrected for ratios that change within it, for steps of
        # varying length.
        super().__init__(internal.uppermost, scheme, sums)
        network, at, self._halved = internal.network, internal.number, halved
        self._rule = EXPONENTIAL if scheme is exponential else _BACKWARD_EULER
        known = dict(enumerate(reduced_times))
        self._reduced_times = [known.get(law) for law in internal.laws]
        self._theta, self._layer = network.times, network.layer
        self._position = np.argsort(at, kind="stable")[np.count_nonzero(at < 0) :]
        wave = at[self._position]
        relaxing, first = np.unique(network.spring, return_index=True)
        self._elements = Elements(
            network.force,
            np.ascontiguousarray(network.projection[:, :, relaxing]),
            np.append(first, network.spring.size),
            network.roots,
            np.searchsorted(wave, np.arange(len(network.force) + 1)),
        )
        self._wave = wave
        self._weights = sums.weights[self._position]
        self._xi = np.zeros((wave.size, network.times.size, 2))
        self._time, self._length = 0.0, 0.0
        self._within: tuple[ComplexArray, FloatArray, float] | None = None
        rates = self._rates(0.0, 0.0)
        glassy = np.asarray(internal.uppermost.glassy)[self._position]
        own = self.shortest_time / float(rates[0])
        self.shortest_time = min(own, sums.minimum(self._shortest_time(glassy, rates)))

    def _shortest_time(self, glassy: FloatArray, rates: FloatArray) -> float:
        """Shortest relevant time of the elements; `glassy` is the stiffness without the network."""
        # Each element relaxes with the others at rest, which is exact for the fastest one.
        of, roots = self._elements, self._elements.roots
        lengths, loads = (of.projection**2).sum(axis=1), np.einsum("kr,kra->ka", of.force, of.projection)
        spring = np.repeat(np.arange(of.first.size - 1), np.diff(of.first))
        softened = 1 + lengths[:, spring] * roots**2
        weights = (loads[:, spring] * roots) ** 2 / softened
        total = np.full(len(of.force), np.inf)
        np.minimum.at(total, self._wave, glassy)
        relevant = weights > RELEVANT * (total + (of.force**2).sum(axis=1))[:, np.newaxis]
        times = self._theta / rates[self._layer] / softened
        return float(times[relevant].min(initial=np.inf))

    def terms(self, step: float) -> tuple[FloatArray, ComplexArray]:
        """Return kappa and b, each of shape (nq,), at the end of a step of this length in time."""
        self._within, self._length = None, step
        self._rate = self._rates(self._time, step)
        self.step = np.nan  # the stiffness is computed anew: that of the last step has the network in it
        super().terms(float(self._rate[0]) * step)
        self._factors_of_step = self._factors_for(step, self._rate)
        self._solved = self._solve(self._factors_of_step, self._xi, self._at(self.u))
        self.stiffness[self._position] += self._solved.kappa[self._wave]
        self._b[self._position] += _spectrum(self._solved.intercept)
        return self.stiffness, self._b

    def curvature_stress(self, curvature: ComplexArray) -> ComplexArray:
        """Part of the stress -sigma at the end of the step that is due to dt^2 u''/2."""
        stress = super().curvature_stress(curvature)
        factors = self._rule.residues * self._rule.curved
        gain = np.einsum("kr,kpr,p->k", self._elements.force, self._solved.gamma, factors).real
        stress[self._position] += gain[self._wave] * curvature[self._position]
        return stress

    def missing_stress(self, spectrum: ComplexArray, curvature: ComplexArray) -> ComplexArray:
        """Part of -sigma due to dt^2 u''/2 and to ratios that change within the step."""
        stress = super().missing_stress(spectrum, curvature)
        if self._halved and self._theta.size:
            of = self._elements
            missing = self._missing(spectrum)[0] * of.roots[:, np.newaxis]
            loads = np.einsum("kr,kra->ka", of.force, of.projection)[self._wave]
            strains = np.add.reduceat(missing, of.first[:-1], axis=1)
            stress[self._position] -= _spectrum(np.einsum("na,nap->np", loads, strains))
        return stress

    def advance(self, spectrum: ComplexArray, curvature: ComplexArray | None = None) -> None:
        """Advance the history over the step of the last `terms`, see `Modes`."""
        missing, more = self._missing(spectrum) if self._halved else (None, 0.0)
        begin, end = self._at(self.u), self._at(spectrum)
        curved = np.empty((0, 2)) if curvature is None else self._at(curvature)
        heat = self._advanced(self._factors_of_step, self._solved, self._xi, begin, end, curved)
        super().advance(spectrum, curvature)
        self._time += self._length
        if missing is not None:
            self._xi += missing
        self.stored += self._sums.total(self._energy(self._xi, end))
        self.dissipated += self._sums.total(heat) + more

    @property
    def internal(self) -> tuple[ComplexArray, IntArray]:
        """The internal vectors xi, (positions, internal), and the numbers of their waves."""
        return self._xi[..., 0] + 1j * self._xi[..., 1], self._position

    def _rates(self, begin: float, length: float) -> FloatArray:
        """Mean rate at which the reduced time of each layer elapses in a step; at its begin for length 0."""

        def rate(of: ReducedTime) -> float:
            return of.step(begin, length) / length if length else 1 / of.factor(begin)

        return np.array(
            [1.0 if reduced_time is None else rate(reduced_time) for reduced_time in self._reduced_times]
        )

    def _factors_for(self, length: float, rates: FloatArray) -> NetworkFactors:
        """Return the factors of a step in which the reduced times elapse at these mean rates."""
        of, rule = self._elements, self._rule
        x = rates[self._layer] * length / self._theta
        E = x[:, np.newaxis] / (x[:, np.newaxis] + rule.poles)
        scaled = of.roots[:, np.newaxis] * E
        squares = of.roots[:, np.newaxis] * scaled
        compliance = np.add.reduceat(squares, of.first[:-1]) if x.size else squares
        decay = 1 - (E * rule.residues).real.sum(axis=1)
        return NetworkFactors(x, decay, np.hstack((scaled.real, scaled.imag)), compliance)

    def _solve(self, factors: NetworkFactors, xi: FloatArray, u: FloatArray) -> Solved:
        """Solve the linear systems of a step that begins with xi and u."""
        (waves, redundant), positions, poles = self._elements.force.shape, len(xi), self._rule.poles.size
        solved = Solved(
            np.empty(waves),
            np.empty((positions, 2)),
            np.empty((waves, poles, redundant), dtype=np.complex128),
            np.empty((positions, 2, poles, redundant), dtype=np.complex128),
        )
        solve_step(self._elements, factors, self._rule, xi, u, solved)
        return solved

    def _advanced(
        self,
        factors: NetworkFactors,
        solved: Solved,
        xi: FloatArray,
        begin: FloatArray,
        end: FloatArray,
        curvature: FloatArray,
    ) -> float:
        """Advance xi by a step; return its heat."""
        before, work, old = self._energy(xi, begin), np.empty(len(xi)), xi.copy()
        advance_step(self._elements, factors, self._rule, solved, end - begin, curvature, xi, work)
        if self._rule is _BACKWARD_EULER:
            x = factors.x[:, np.newaxis]
            rate = np.divide((xi - old) ** 2, x, out=np.zeros_like(xi), where=x > 0)
            return float(self._weights @ rate.sum(axis=(1, 2)))
        # Not negative but for the rounding of the energies.
        return max(0.0, float(self._weights @ work) - (self._energy(xi, end) - before))

    def _energy(self, xi: FloatArray, u: FloatArray) -> float:
        """Energy of the network at the wavenumbers of this process."""
        energy = np.empty(len(xi))
        network_energy(self._elements, xi, u, energy)
        return float(self._weights @ energy)

    def _at(self, spectrum: ComplexArray) -> FloatArray:
        """Real and imaginary parts where there is a network, shape (positions, 2)."""
        return spectrum[self._position].view(np.float64).reshape(-1, 2)

    def _missing(self, spectrum: ComplexArray) -> tuple[FloatArray, float]:
        """Change of xi and of the heat because the ratios change within the step."""
        if self._within is None or self._within[0] is not spectrum:
            self._within = (spectrum, *self._by_halves(spectrum))
        return self._within[1:]

    def _by_halves(self, spectrum: ComplexArray) -> tuple[FloatArray, float]:
        half, begin, end = self._length / 2, self._at(self.u), self._at(spectrum)
        rates = [self._rates(start, half) for start in (self._time, self._time + half)]
        if all(np.allclose(each / each[0], self._rate / self._rate[0], rtol=_SAME, atol=0) for each in rates):
            return np.zeros_like(self._xi), 0.0
        part = rates[0][0] / (rates[0][0] + rates[1][0])
        ends = (begin + (end - begin) * part, end)
        none, xi, whole, heat, u = np.empty((0, 2)), self._xi.copy(), self._xi.copy(), 0.0, begin
        for rate, after in zip(rates, ends, strict=True):
            factors = self._factors_for(half, rate)
            heat += self._advanced(factors, self._solve(factors, xi, u), xi, u, after, none)
            u = after
        heat -= self._advanced(self._factors_of_step, self._solved, whole, begin, end, none)
        return (xi - whole) * (4 / 3), self._sums.total(heat) * (4 / 3)


def _spectrum(parts: FloatArray) -> ComplexArray:
    """Return the spectrum of real and imaginary parts, (positions, 2)."""
    return parts.view(np.complex128)[:, 0]
