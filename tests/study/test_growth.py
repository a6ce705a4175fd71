"""A study that grows keeps its complete cases, and gives the bits of the study that was asked at once."""

from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from gfmdlayer.config import Config, digest
from gfmdlayer.results import provenance
from gfmdlayer.results.reader import open_results
from gfmdlayer.study.cases import cases
from gfmdlayer.study.claims import Claim
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.status import overview

BASE = {
    "grid.points": 64, "trajectory.ramp_time": 0.4, "time.end": 1.0, "time.step": 0.1,
    "output.keep_state": True,
}  # fmt: skip
THICKNESS = "layer.thickness"
STEPS = {
    "landing": {"output.snapshots": [0.4]},
    # 0.6/0.07 is not a whole number: the steps are shorter than asked for, and others to another end.
    "fitted": {"output.snapshots": [0.4], "time.step": 0.07},
    "paper": {"time.integrator": "backward_euler", "output.snapshots": [0.4]},
    "adaptive": {"time.step": "adaptive", "time.tolerance": 1e-3, "output.times": [0.5]},
    "load": {"trajectory": {"control": "load", "load": 0.05, "ramp_time": 0.4}, "time.step": "adaptive",
             "output.times": [0.5], "output.patches": True},
    "sliding": {"trajectory.velocity": 0.3, "time.step": "adaptive", "output.times": [0.5]},
    "surface": {"grid.points": [16, 8], "grid.period": [1.0, 0.5]},
}  # fmt: skip


class Killed(BaseException):
    """Ends a run without the exception handlers of its cases."""


def study(sweep, **values):
    given = Config(name="study").with_values(BASE | {k.replace("__", "."): v for k, v in values.items()})
    return Config.model_validate(given.model_dump(exclude_unset=True) | {"sweep": sweep})


def steps(kind):
    return {key.replace(".", "__"): value for key, value in STEPS[kind].items()}


@contextmanager
def killed_after(number):
    """Let a run die after so many attempts at steps, in all its cases together."""
    left, advance = number, Claim.advance

    def dying(self, time):
        nonlocal left
        left -= 1
        if left < 0:
            raise Killed
        advance(self, time)

    with pytest.raises(Killed), pytest.MonkeyPatch.context() as patch:  # noqa: PT012
        patch.setattr(Claim, "advance", dying)
        yield


def same(grown, at_once, bits):
    """Compare the arrays of all cases, and those of the sweep files but the numbers of the cases."""
    found, wanted = bits(grown / "sweep.h5"), bits(at_once / "sweep.h5")
    assert {k: v for k, v in found.items() if k != "case"} == {k: v for k, v in wanted.items() if k != "case"}
    with h5py.File(grown / "sweep.h5") as one, h5py.File(at_once / "sweep.h5") as other:
        pairs = zip(np.ravel(one["case"]), np.ravel(other["case"]), strict=True)
        for number, place in pairs:
            # The file of a case names the keys of the sweep that computed it, which may have been another.
            both = bits(Folder(grown).case(number)), bits(Folder(at_once).case(place))
            first, second = ({k: v for k, v in each.items() if k != "shear_modulus"} for each in both)
            assert first == second


@pytest.mark.parametrize("kind", STEPS)
def test_a_study_that_grew_three_times_and_was_killed_twice_has_the_bits_of_one_asked_at_once(
    kind, run_here, bits, tmp_path
):
    grown, at_once, given = tmp_path / "grown", tmp_path / "once", steps(kind)
    run_here(study({THICKNESS: [0.1, 0.3]}, **given), grown)
    more = given | {"time__end": 2.0, "output__snapshots": [*given.get("output__snapshots", ()), 1.0, 2.0]}
    with killed_after(6):
        run_here(study({THICKNESS: [0.02, 0.1, 0.3]}, **given), grown, checkpoint_every=0)
    run_here(study({THICKNESS: [0.02, 0.1, 0.3]}, **given), grown)
    with killed_after(7):
        run_here(study({THICKNESS: [0.02, 0.1, 0.3]}, **more), grown, checkpoint_every=0)
    whole = study({THICKNESS: [0.02, 0.1, 0.3], "halfspace.shear_modulus": [1.0, 4.0]}, **more)
    _, log = run_here(whole, grown)
    run_here(whole, at_once)
    same(grown, at_once, bits)
    assert "goes on from time" in log


def test_a_longer_end_goes_on_from_the_kept_state(run_here, bits):
    given = steps("adaptive")  # the others are among those that grew three times
    run_here(study({THICKNESS: [0.1, 0.3]}, **given), "out")
    _, log = run_here(study({THICKNESS: [0.1, 0.3]}, **given, time__end=2.0), "out")
    assert "0 complete, 2 go on from t = " in log.replace("1 goes on from t = ", "2 go on from t = ", 1)
    assert "not in the sweep, left in place: cases 0000, 0001" in log
    run_here(study({THICKNESS: [0.1, 0.3]}, **given, time__end=2.0), "once")
    same(Path("out"), Path("once"), bits)


def test_only_the_new_cases_of_a_grown_sweep_are_computed(run_here):
    run_here(study({THICKNESS: [0.1, 0.3]}))
    before = {path: path.read_bytes() for path in Path("out/cases").glob("*.h5")}
    summary, log = run_here(study({THICKNESS: [0.02, 0.1, 0.2, 0.3]}))
    assert "2 complete, 2 new" in log
    assert summary.count("complete") == 4
    assert {path: path.read_bytes() for path in before} == before
    with open_results("out") as results:
        assert results["thickness"].to_numpy().tolist() == [0.02, 0.1, 0.2, 0.3]
        assert results["case"].to_numpy().tolist() == [2, 0, 3, 1]
    # Without the two that came first, and with them again: nothing is computed.
    _, log = run_here(study({THICKNESS: [0.02, 0.2]}))
    assert "2 complete" in log
    assert "not in the sweep, left in place: cases 0000, 0001" in log
    assert (overview(Folder(Path("out"))).total, overview(Folder(Path("out"))).complete) == (2, 2)
    summary, log = run_here(study({THICKNESS: [0.3, 0.2, 0.1, 0.02]}))
    assert "4 complete" in log
    assert "ended in" not in log
    with open_results("out") as results:
        assert results["case"].to_numpy().tolist() == [1, 3, 0, 2]
        assert not results["pressure"].isnull().any() if "pressure" in results else True
    assert {path: path.read_bytes() for path in before} == before


SPRINGPOT = {"model": "fractional_zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0, "exponent": 0.5}
# Why a longer end cannot go on: the keys of the study, those that change with the end, and their message.
AGAIN = {
    "without a kept state": ({"output__keep_state": False}, {}, ""),
    "a snapshot before the kept state": (
        steps("paper"), {"output__snapshots": [0.4, 0.6]}, "; output.snapshots: (0.4,) -> (0.4, 0.6)",
    ),
    "a law whose series belongs to the end": ({"layer__material": SPRINGPOT}, {}, ""),
}  # fmt: skip


@pytest.mark.parametrize("reason", AGAIN)
def test_a_longer_end_that_no_state_reaches_is_computed_again_and_says_so(reason, run_here, bits):
    before, change, said = AGAIN[reason]
    after = before | change | {"time__end": 2.0}
    run_here(study({}, **before))
    assert before.get("output__keep_state", True) or not list(Path("out/cases").glob("*.state"))
    _, log = run_here(study({}, **after))
    assert f"computed again: case 0001: time.end: 1.0 -> 2.0{said}" in log
    run_here(study({}, **after | {"output__keep_state": True}), "once")
    same(Path("out"), Path("once"), bits)
    with open_results("out") as only:
        assert only["time"][-1] == 2.0


def test_asking_for_the_state_later_changes_nothing_in_what_is_complete(run_here):
    before, after = study({}, output__keep_state=False), study({})
    assert digest(cases(before)[0].config) == digest(cases(after)[0].config)
    run_here(before)
    _, log = run_here(after)
    assert "1 complete" in log
    assert "ended in" not in log


def test_one_changed_case_of_a_list_is_computed_again(run_here):
    tolerance = "solver.tolerance"
    run_here(study({"zip": {THICKNESS: [0.1, 0.3], tolerance: [1e-6, 1e-6]}}))
    _, log = run_here(study({"zip": {THICKNESS: [0.1, 0.3], tolerance: [1e-6, 1e-8]}}))
    assert "1 complete, 1 new" in log
    assert "not in the sweep, left in place: case 0001" in log


def test_a_state_that_other_versions_kept_is_not_used(run_here, monkeypatch):
    made_by = provenance.made_by
    monkeypatch.setattr(provenance, "made_by", lambda digest: made_by(digest) | {"numba_version": "other"})
    run_here(study({}))
    monkeypatch.undo()
    _, log = run_here(study({}, time__end=2.0))
    assert "goes on" not in log
    assert "computed again: case 0001: time.end" in log


@pytest.mark.parametrize("damage", ["case", "snapshot", "state"])
def test_a_case_whose_earlier_one_is_damaged_begins_anew(damage, run_here, bits):
    run_here(study({}, output__snapshots=[0.4]))
    path = Folder(Path("out")).case(0, "state" if damage == "state" else "h5")
    content = bytearray(path.read_bytes())
    if damage == "snapshot":  # which is not read to find whether a case is complete
        with h5py.File(path) as file:
            content[file["pressure"].id.get_chunk_info(0).byte_offset + 8] ^= 1
    else:
        del content[len(content) // 2 :]
    path.write_bytes(content)
    _, log = run_here(study({}, output__snapshots=[0.4], time__end=2.0))
    assert ("not from the state of case 0000" in log) == (damage != "state")  # which is passed over
    run_here(study({}, output__snapshots=[0.4], time__end=2.0), "once")
    same(Path("out"), Path("once"), bits)


def test_numbers_of_cases_are_read_back_from_the_head_of_the_configuration(tmp_path):
    folder = Folder(tmp_path)
    for numbers in ([0], [0, 1, 2], [3, 4, 5, 0, 7, 6, 2], [1]):
        folder.store(study({}), numbers)
        assert list(folder.case_numbers()) == numbers
