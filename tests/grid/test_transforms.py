"""The transforms against numpy's, and plans that are reproduced from wisdom."""

import numpy as np
import pytest

from gfmdlayer.files.whole import read_sealed, write_sealed
from gfmdlayer.grid import wisdom
from gfmdlayer.grid.fftw import forget_wisdom
from gfmdlayer.grid.transforms import Transforms

SHAPES = [(8,), (9,), (1024,), (1155,), (6, 8), (5, 9), (6, 9), (7, 8), (32, 64)]


def rounding(shape):
    """Relative 2-norm error of a fast transform: a few roundings for each of its log2 n levels."""
    return float(4 * np.finfo(float).eps * np.log2(np.prod(shape)))


def fields(shape):
    return np.random.default_rng(3).standard_normal(shape)


@pytest.mark.parametrize("shape", [*SHAPES, (512,), (24, 40)])
def test_forward_is_numpys_and_backward_multiplies_it_by_the_number_of_points(shape):
    transforms, u = Transforms(shape), fields(shape)
    exact, spectrum = np.fft.rfftn(u), transforms.forward(u)
    assert np.linalg.norm(spectrum - exact.ravel()) <= rounding(shape) * np.linalg.norm(exact)
    before = spectrum.copy()
    back = transforms.backward(spectrum) / u.size
    assert np.linalg.norm(back - u.ravel()) <= 2 * rounding(shape) * np.linalg.norm(u)
    np.testing.assert_array_equal(spectrum, before)  # backward leaves the caller's spectrum alone


def test_plans_of_the_same_wisdom_are_made_once_and_live_as_long_as_they_are_used():
    shape, u = (48,), fields((48,))
    forget_wisdom()
    first = Transforms(shape)
    assert Transforms(shape).plans == first.plans
    known, expected = first.wisdom, first.forward(u)
    informed = Transforms(shape, known)
    assert Transforms(shape, known).plans == informed.plans
    assert Transforms((96,), known).for_window(2).plans == informed.plans
    forget_wisdom()
    for _ in range(3):  # new plans, which would take the place of old ones that are gone
        Transforms(shape)
        forget_wisdom()
    np.testing.assert_array_equal(first.forward(u), expected)
    np.testing.assert_array_equal(informed.forward(u), expected)


@pytest.mark.parametrize("shape", [(4096,), (2187,), (48, 64)])
def test_the_same_wisdom_gives_the_same_bits(shape):
    u = fields(shape)
    forget_wisdom()
    first = Transforms(shape)
    known, forward = first.wisdom, first.forward(u)
    backward = first.backward(forward)
    for _ in range(3):
        forget_wisdom()
        again = Transforms(shape, known)
        np.testing.assert_array_equal(again.forward(u), forward)
        np.testing.assert_array_equal(again.backward(forward), backward)
        # Nothing was measured anew.
        assert sorted(again.wisdom.splitlines()) == sorted(known.splitlines())


@pytest.mark.parametrize("shape", [(512, 512), (513, 511)])
def test_threads_change_a_transform_by_rounding_only(shape):
    u = fields(shape)
    one, two = Transforms(shape, time_limit=0.1), Transforms(shape, time_limit=0.1, threads=2)
    spectrum = one.forward(u)
    # log2(n) butterflies of a rounding each, on values that add up to n^(1/2).
    bound = 20 * np.finfo(float).eps
    np.testing.assert_allclose(two.forward(u), spectrum, atol=bound * np.abs(spectrum).max())
    np.testing.assert_allclose(two.backward(spectrum) / u.size, u.ravel(), atol=bound * np.abs(u).max())


def test_plans_for_threads_are_kept_apart(tmp_path):
    wisdom.planned((64,), tmp_path)
    wisdom.planned((64,), tmp_path, threads=2)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == 2
    assert names[0].replace("-2threads", "") == names[1]


def test_wisdom_of_another_fftw_is_ignored():
    u = fields((16,))
    np.testing.assert_allclose(Transforms((16,), "(not wisdom)").forward(u), np.fft.rfft(u), atol=1e-14)


def test_wisdom_is_kept_in_the_folder_and_read_from_it(tmp_path):
    folder = tmp_path / "deep" / "cache"
    first = wisdom.planned((64,), folder)
    assert first.startswith("(fftw")
    assert wisdom.planned((64,), folder) == first
    assert [read_sealed(path) for path in folder.iterdir()] == [first.encode()]


def test_wisdom_has_the_plans_of_coarser_grids_and_gets_those_that_it_lacks(tmp_path, recwarn):
    """Lines too have plans in single precision, which differ from run to run where they are measured anew."""
    first = wisdom.planned((512,), tmp_path)
    double, begin, single = first.partition("\n(fftw")
    assert "codelet" in single
    (kept,) = tmp_path.iterdir()
    head, _, _ = single.partition("\n")
    write_sealed(kept, f"{double}{begin}{head}\n)\n".encode())
    forget_wisdom()
    more = wisdom.planned((512,), tmp_path)
    assert set(double.splitlines()) < set(more.splitlines())
    assert "codelet" in more.partition("\n(fftw")[2]
    assert read_sealed(kept) == more.encode()
    assert not recwarn.list


def test_of_two_runs_that_measure_at_the_same_time_both_use_the_plans_of_the_first(tmp_path, monkeypatch):
    wisdom.planned((64,), tmp_path)
    (kept,) = tmp_path.iterdir()
    kept.unlink()

    class MeasuresWhileAnotherFinishes(Transforms):
        def __init__(self, shape, known, threads):
            super().__init__(shape, known, threads=threads)
            write_sealed(kept, b"the other's")

    monkeypatch.setattr(wisdom, "Transforms", MeasuresWhileAnotherFinishes)
    assert wisdom.planned((64,), tmp_path) == "the other's"
    assert [read_sealed(path) for path in tmp_path.iterdir()] == [b"the other's"]


def test_a_run_uses_its_own_plans_and_says_so_if_the_folder_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")  # no folder can be made below a file, even by root
    with pytest.warns(UserWarning, match=r"plans cannot be kept \(Not a directory\); results may differ"):
        assert wisdom.planned((64,), tmp_path / "file" / "cache").startswith("(fftw")


def changed_bit(content):
    return content[:200] + bytes([content[200] ^ 1]) + content[201:]


DAMAGES = {
    "empty": lambda _: b"",
    "truncated": lambda content: content[:100],
    "garbage": lambda _: b"\xff garbage" * 50,
    "a changed bit": changed_bit,  # at which FFTW aborts
    "without plans": lambda _: b"",
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_wisdom_is_said_and_replaced_by_that_of_the_results(damage, tmp_path):
    user, results = tmp_path / "user", tmp_path / "results"
    known = wisdom.planned((64,), user, results=results)
    kept = next(user.iterdir())
    kept.write_bytes(DAMAGES[damage](kept.read_bytes()))
    if damage == "without plans":
        write_sealed(kept, b"(fftw-3.3.5 fftw_wisdom)")
        with pytest.warns(UserWarning, match=r"wisdom: is not of this FFTW and is replaced; results may"):
            wisdom.planned((64,), user)
    else:
        with pytest.warns(UserWarning, match=r"wisdom: is damaged and is replaced; results may differ"):
            wisdom.planned((64,), user)
    kept.unlink()
    assert wisdom.planned((64,), user, results=results) == known
    assert read_sealed(kept) == known.encode()
