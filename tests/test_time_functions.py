"""Prescribed functions of time."""

import numpy as np

from gfmdlayer.time_functions import Table


def test_a_table_is_linear_between_its_rows_as_numpy_has_it():
    random = np.random.default_rng(0)
    times, values = np.cumsum(random.random(20)) - 0.1, random.standard_normal(20)
    table = Table(times, values)
    asked = [*times, *random.uniform(-1.0, times[-1] + 1.0, 500), np.inf]
    assert [table(time) for time in asked] == np.interp(asked, times, values).tolist()
