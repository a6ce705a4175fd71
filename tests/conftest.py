"""What the tests share: recorder, small runs, elastic closed form, dense contact, bits of files, browser."""

import fcntl
import gc
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import settings
from matplotlib.figure import Figure
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from scipy.optimize import nnls

from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.verification import theory
from tests.recordings import Kept

# `pytest tests/test_fuzz_*.py --hypothesis-profile=long` is the long run. Without it a test that has passed
# draws the same examples again, so that what breaks it is what was changed.
settings.register_profile("short", derandomize=True, deadline=None)
settings.register_profile("long", max_examples=10_000, print_blob=True, deadline=None)
settings.load_profile("short")


def pytest_collection_finish():
    """Modules and tests stay: the collector of garbage need not look through them each time."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def signals_reach_programs():
    """Programs that tests start inherit no ignored signal, as of nohup or of a shell's background."""
    for signum in (signal.SIGHUP, signal.SIGINT):
        if signal.getsignal(signum) == signal.SIG_IGN:
            signal.signal(signum, lambda *_: None)  # still ignored here, and not by programs


@pytest.fixture(scope="session", autouse=True)
def kernels_are_compiled_once(tmp_path_factory):
    """Of several processes of tests one compiles a kernel, and the others wait until it is in the cache."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    compiled, place, at_work = Dispatcher.compile, tmp_path_factory.getbasetemp().parent, set()

    def compiled_once(kernel, signature):
        name = f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}.lock"
        if kernel.stats.cache_path is None or name in at_work:
            return compiled(kernel, signature)
        with global_compiler_lock, (place / name).open("w") as file:  # threads in the order of processes
            fcntl.flock(file, fcntl.LOCK_EX)
            at_work.add(name)
            gc.disable()  # a sixth of the time
            try:
                return compiled(kernel, signature)
            finally:
                gc.enable()
                at_work.remove(name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", compiled_once)
        yield


@pytest.fixture(scope="session")
def recorder():
    """A recorder that keeps everything."""
    return Kept


@pytest.fixture(scope="session")
def run():
    """Run the paper's default case with these dotted values in it, on fewer points and with longer steps."""

    def run(values):
        coarse = {"grid.points": 2048, "time.integrator": "exponential", "time.step": 0.05}
        recording = Kept()
        simulate(Config(name="test").with_values(coarse | values), recording)
        return recording

    return run


@pytest.fixture(scope="session")
def parabola_on_halfspace():
    """Contact fraction and pbar/2G at depths of a parabola, R = L/4, on an incompressible halfspace."""

    def answer(depths):
        half_widths = np.array([theory.parabola_half_width(depth) for depth in np.atleast_1d(depths)])
        return 2 * half_widths, theory.parabola_pressure(half_widths) / 2

    return answer


class DenseContact:
    """Random small contact problems, and their solution by dense linear algebra, on a grid of period 1."""

    def __init__(self, shape):
        self.grid = Grid(shape, (1.0,) * len(shape))

    def problem(self, seed, condition):
        """Return a rough punch on a body with a history, whose stiffness is scattered by mode."""
        rng = np.random.default_rng(seed)
        q, size = self.grid.wavenumbers.ravel(), self.grid.size
        kappa = q * np.exp(0.5 * np.sin(0.3 * q))  # a function of |q|, as isotropy asks
        h = rng.uniform(-1, 1, size)
        h += rng.uniform(0.05, 0.4) - h.mean()
        b = self.transform(rng.normal(0, 1, size))
        b[0] = 0.0  # a mean that does not resist remembers nothing
        if condition == "free mean":
            kappa[0] = 3.0
            b[0] = size * rng.uniform()
        return Problem(kappa, b, h, rng.uniform(0.5, 2) if condition == "load" else None)

    def transform(self, values):
        return np.asarray(np.fft.rfftn(values.reshape(self.grid.shape)).ravel())

    def force(self, problem, u):
        """Return IFFT(-kappa FFT(u) + b), by numpy."""
        spectrum = problem.intercept - problem.stiffness * self.transform(u)
        axes = tuple(range(len(self.grid.shape)))
        spectrum = spectrum.reshape(self.grid.spectral_shape)
        return np.asarray(np.fft.irfftn(spectrum, s=self.grid.shape, axes=axes).ravel())

    def solution(self, problem):
        """Return displacement and pressure.

        Non-negative least squares on the gaps guess the contact set, whose linear equations are then solved.
        The guess is mended where it is wrong; that every inequality holds by a margin proves it.
        """
        size, h = problem.obstacle.size, problem.obstacle
        no_history = replace(problem, intercept=np.zeros_like(problem.intercept))
        K = -np.column_stack([self.force(no_history, column) for column in np.eye(size)])
        f0 = self.force(problem, np.zeros(size)) + problem.applied_pressure
        # With the mean held by a stiff spring, the gaps w >= 0 minimise w K w/2 - w (K h - f0).
        held = K + (1e5 if problem.mean_is_fixed else 1e-9) * (problem.stiffness[0] == 0) / size
        L = np.linalg.cholesky(held)
        gaps, _ = nnls(L.T, np.linalg.solve(L, held @ h - f0), maxiter=100 * size)
        free = gaps > 0

        for _ in range(size):
            u, pressure = self._with_contact(problem, K, f0, free)
            mended = np.where(free, u < h, pressure < 0)
            if (mended == free).all():
                break
            free = mended
        margin = np.where(free, (h - u) / -u.min(), pressure / pressure.max())
        assert not free.all()
        assert margin.min() > 1e-8
        assert np.abs(pressure[free]).max() < 1e-10 * pressure.max()
        return u, pressure

    @staticmethod
    def _with_contact(problem, K, f0, free):
        """Return displacement and pressure with a given contact set."""
        h = problem.obstacle
        u, multiplier = h.copy(), 0.0
        K_free, load = K[np.ix_(free, free)], f0[free] - K[np.ix_(free, ~free)] @ h[~free]
        if problem.mean_is_fixed:
            ones = np.ones((K_free.shape[0], 1))
            matrix = np.block([[K_free, -ones], [-ones.T, np.zeros((1, 1))]])
            *u_free, multiplier = np.linalg.solve(matrix, [*load, h[~free].sum()])
            u[free] = u_free
        else:
            u[free] = np.linalg.solve(K_free, load)
        return u, f0 - K @ u + multiplier


@pytest.fixture(scope="session")
def dense_contact():
    """Random small problems on a grid, and who knows their answers."""
    return DenseContact


@pytest.fixture(scope="session")
def bits():
    """Return the bits of every variable of an HDF5 file, or of every such file in a results folder."""

    def bits(place):
        place, found = Path(place), {}
        for path in sorted(place.rglob("*.h5")) if place.is_dir() else [place]:
            prefix = f"{path.relative_to(place)}:" if place.is_dir() else ""
            with h5py.File(path) as h5:
                found |= {f"{prefix}{name}": np.asarray(h5[name]).tobytes() for name in h5}
        return found

    return bits


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures are built and get their files, which stay empty: drawing takes most of a second each.

    The frames of a movie, which its writer draws into memory, are drawn.
    """
    drawn = Figure.savefig

    def savefig(figure, file, **settings):
        return Path(file).touch() if isinstance(file, str | Path) else drawn(figure, file, **settings)

    monkeypatch.setattr(Figure, "savefig", savefig)


BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium of this machine."""
    playwright = pytest.importorskip("playwright.sync_api")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is in the PATH")
    with playwright.sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=found, args=["--no-sandbox"])


@pytest.fixture
def visit(browser):
    """Open a page; at the end nothing may have been logged as an error, and nothing loaded from elsewhere."""
    opened = []
    wrong = []

    def visit(path, width=1280, scheme="light", ready="html"):
        opened.append(browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme))
        page = opened[-1].new_page()
        page.set_default_timeout(300_000)  # a machine under load is slow to draw
        page.on(
            "console", lambda each: wrong.append(each.text) if each.type in ("error", "warning") else None
        )
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on(
            "request",
            lambda each: None if each.url.startswith(("file:", "blob:", "data:")) else wrong.append(each.url),
        )
        page.goto(path.as_uri())
        page.wait_for_selector(ready, state="attached")
        return page

    yield visit
    for each in opened:
        each.close()
    assert wrong == []


@pytest.fixture
def flaws():
    """Text of a page that a reader would miss; boxes that match `unscrolled` may not scroll."""
    script = Path(__file__).with_name("flaws.js").read_text(encoding="utf-8")

    def flaws(page, root="body", unscrolled=""):
        return page.evaluate(script, [root, unscrolled])

    return flaws
