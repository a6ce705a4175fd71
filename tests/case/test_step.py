"""Fields of a step: computed when they are read, and gone with the step."""

import gc
import weakref

import numpy as np

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import NoRecorder
from gfmdlayer.config import Config
from gfmdlayer.step import Fields

SLIDING = {"trajectory.velocity": 1.0, "grid.points": 64, "time.end": 0.5, "time.step": 0.125}


def test_a_field_is_computed_once_and_only_when_it_is_read():
    calls = []
    fields = Fields(gap=np.zeros(3), touching=lambda fields: calls.append(fields) or fields["gap"] == 0)
    assert "touching" in fields
    assert "stick" not in fields
    assert len(fields) == 2
    assert not calls
    assert fields["touching"].all()
    assert fields["touching"].all()
    assert len(calls) == 1
    fields.add(gap=np.ones(3))
    assert fields["gap"].all()


def test_the_memory_of_a_step_is_free_before_the_next_attempt():
    """No circle of references holds the fields: of large surfaces they take most of the memory."""
    frictional = {"interface": {"law": "coulomb", "coefficient": 0.3}, "layer.poisson": 0.3}
    inside = {"output.inside": {"depths": [0.01], "every": 1}}
    for values in ({}, {"interface": {"law": "hard_wall", "hardness": 0.05}}, inside, frictional):
        config = Config(name="memory").with_values(SLIDING | values)
        Case(config).run(NoRecorder())  # compiles: the compiler holds on to arguments
        case = Case(config)
        alive, attempt = [], case.contact.attempt

        def attempted(instant, alive=alive, attempt=attempt):
            assert all(fields() is None for fields in alive)
            step = attempt(instant)
            alive.append(weakref.ref(step.fields))
            return step

        case.contact.attempt, case.stepwise = attempted, True
        gc.disable()
        try:
            case.run(NoRecorder())
        finally:
            gc.enable()
        assert len(alive) == 5
