"""What may be read off the paper's figures, redrawn from our runs."""

import pytest

from bench.paper import figures
from bench.publish import report

pytestmark = pytest.mark.hard  # eight patches, most with a kernel of its own


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    kept, report.FIGURES = report.FIGURES, folder
    found = []
    figures.first(found)
    figures.second(found)
    figures.fourth(found)
    figures.fifth(found)
    figures.sixth(found)
    figures.driven(found)
    report.FIGURES = kept
    assert sorted(p.name for p in folder.iterdir()) == [f"paper_{n}.png" for n in (1, 2, 4, 5, 6, 7)]
    return {(figure, quantity): (paper, ours) for figure, quantity, paper, ours in found}


def test_energy_is_kept_in_every_figure(rows):
    errors = {key: float(ours) for key, (_, ours) in rows.items() if "energy error" in key[1]}
    assert {figure for figure, _ in errors} == {"1", "2", "5", "6"}
    assert max(errors.values()) <= 5e-14


@pytest.mark.parametrize(
    ("key", "within"),
    [(("2", "deepest, v·√(m/kc), m"), 1e-3), (("5", "height of return, m"), 1e-3), (("6", "energy, ½k·y0², J"), 1e-3)],
    ids=str,
)
def test_numbers_read_off(rows, key, within):
    paper, ours = rows[key]
    assert float(ours) == pytest.approx(float(paper), rel=within)


def test_the_effective_force_is_the_power_law(rows):
    """Eq. (22), where both ends of the step are inside. A mean over the step is above a convex law in its middle."""
    for alpha in ("1", "2.4"):
        low, high = (
            float(part) for part in rows["4", f"force over kc·y^α, both ends inside, α = {alpha}"][1].split(" to ")
        )
        assert 0.999 <= low <= high < (1.001 if alpha == "1" else 2.0)


def test_the_driven_ball_comes_to_rest(rows):
    """Fig. 7: no limit cycle."""
    assert float(rows["7", "speed left after 20 s, m/s"][1]) <= 1e-6
