"""The slope of where a ball ends by where it began, through a contact."""

import numpy as np
import pytest

from bench.ruler.slope import STARTS, engine_ends, largest_error


@pytest.mark.hard
@pytest.mark.parametrize(("order", "substeps", "most"), [(2, 1, 1e-3), (4, 1, 2e-3), (6, 1, 2e-3), (4, 8, 1e-4)])
def test_the_slope_through_a_contact_of_ten_steps(order, substeps, most):
    assert largest_error(engine_ends(order, substeps, 1e5)) <= most


@pytest.mark.hard
@pytest.mark.parametrize("stiffness", [1e7, 1e9])
def test_the_mean_slope_through_a_contact_shorter_than_a_step(stiffness):
    slopes = np.diff(engine_ends(2, 1, stiffness)) / np.diff(STARTS)
    assert slopes.mean() == pytest.approx(-1.0, abs=1e-3)
    assert -2.0 < slopes.min() < -1.5 and -0.6 < slopes.max() < -0.4
