"""An instrument beside recordings of one: keyboards of which it is known how far they are from each other."""

import tomllib

import numpy as np
import pytest
from conftest import ROOT

import engine
from bench.recordings import command, tune
from bench.recordings.instrument import STRING_LAYERS, VELOCITY, compare_keys, seconds_needed, slope_factor
from bench.recordings.keys import key_frequency
from bench.recordings.piano import render_note
from bench.recordings.tables import key_row
from bench.recordings.targets import layer_table, octave_table, target_table

RATE = 44_100
KEYS = (48, 51, 54)


def keyboard(stiffness: float = 3e-4, early: float = 20.0, late: float = 5.0, brighter: float = 1.0):
    """Strings that fall in two stages, dB/s, from a knee at 0.4 s; a harder blow has `brighter` dB more of partials
    above 2 kHz per dB."""

    def sound_of(key: int, velocity: int, seconds: float = 6.0):
        if velocity not in STRING_LAYERS:
            return None
        t = np.arange(round(seconds * RATE)) / RATE
        level = velocity - VELOCITY
        fall = np.minimum(1.0, t / 0.01) * 10 ** (-(early * np.minimum(t, 0.4) + late * np.maximum(t - 0.4, 0.0)) / 20)
        sound = 1e-5 * np.random.default_rng(key).standard_normal(len(t))
        for n in range(1, 31):
            frequency = n * key_frequency(key) * np.sqrt((1 + stiffness * n**2) / (1 + stiffness))
            gain = level + (brighter * level - 30.0 if frequency > 2000.0 else 0.0)
            sound += 10 ** (gain / 20) / n * fall * np.sin(2 * np.pi * frequency * t + n)
        return sound[:, None], RATE

    return sound_of


def compare(rendered, recorded):
    return list(compare_keys(KEYS, recorded, rendered))


@pytest.mark.hard
def test_an_instrument_is_not_far_from_itself():
    results = list(compare(keyboard(), keyboard()))
    assert results
    for result in results:
        off = result.off
        assert off.levels < 0.5  # noise of other lengths
        assert off.stiffness < 0.01 and off.brightness < 0.01
        assert (off.early, off.late) == pytest.approx((1.0, 1.0), rel=0.05)
        assert result.recorded.cents == pytest.approx(0.0, abs=0.3)
        assert result.recorded.brightness == pytest.approx(1.0, rel=0.1)


@pytest.mark.hard
def test_each_difference_is_seen_in_its_own_column():
    """Strings half as stiff again, that fall 1.3 times as fast at first and half as fast later, and brighten twice as
    fast."""
    results = list(compare(keyboard(4.5e-4, 26.0, 2.5, 2.0), keyboard()))
    assert results
    for result in results:
        assert result.off.stiffness == pytest.approx(0.5, rel=0.03)
        assert result.off.early == pytest.approx(1.3, rel=0.1)
        assert result.off.late == pytest.approx(2.0, rel=0.1)
        assert result.off.brightness == pytest.approx(1.0, rel=0.1)
        assert result.rendered.inharmonicity == pytest.approx(4.5e-4, rel=0.03)


@pytest.mark.hard
def test_a_neighbour_that_is_retuned_has_the_stiffness_of_its_own_strings():
    """Playing a sound faster keeps B, and makes it fall faster by the interval."""
    result = compare(keyboard(), keyboard())[0]
    assert result.neighbour.stiffness < 0.01
    assert result.neighbour.early == pytest.approx(2 ** (3 / 12), rel=0.06)


def test_a_faster_and_a_slower_fall_are_equally_far():
    recorded = np.array([-10.0, -20.0, np.nan, -30.0])
    for factor in (2.0, 0.5):
        assert slope_factor(factor * recorded, recorded) == pytest.approx(2.0)
    assert np.isnan(slope_factor(np.full(4, np.nan), recorded))


@pytest.mark.hard
def test_keys_that_were_fitted_are_counted_apart():
    def bad_where_not_fitted(key, velocity, seconds):
        return keyboard(late=5.0 if key == KEYS[0] else 20.0)(key, velocity, seconds)

    header, rows = target_table(compare(bad_where_not_fitted, keyboard()), (KEYS[0],))
    by_name = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert [by_name["number of notes"][name] for name in ("this piano", "keys used for tuning")] == ["6", "3"]
    late = by_name["late decay of partials, factor"]
    assert (late["target met"], float(late["keys used for tuning"])) == ("not met", pytest.approx(1.0, abs=0.1))
    assert by_name["inharmonicity"]["target met"] == "met"
    assert by_name["third octaves, dB"]["target met"] == "not met"


@pytest.mark.hard
def test_a_key_that_the_instrument_lacks_has_a_row_and_counts_in_no_mean():
    results = compare(lambda key, velocity, seconds: None, keyboard())
    assert key_row(results[0])[:3] == ["C3", "", ""]
    for row in target_table(results, ())[1]:
        assert row[2] in ("0", "") and row[3] == ""
    assert all(row[1] == "" for row in layer_table(results, ())[1])
    assert not octave_table(results, ())[1]


def test_tuning_on_more_than_one_key_in_three_is_refused(monkeypatch, capsys):
    monkeypatch.setattr(command.piano, "FITTED_KEYS", (48, 51))
    assert command.compare_piano(set(KEYS), keyboard()) == 2
    assert "one in three" in capsys.readouterr().err


@pytest.mark.hard
def test_a_number_is_fitted_to_recorded_notes(monkeypatch):
    """Hammers of twice the speed of those recorded are slower once it is fitted; a board has no lid."""
    document = tomllib.loads((ROOT / "patches" / "templates" / "piano.toml").read_text("utf-8"))
    monkeypatch.setattr(tune, "ROUNDS", 1)
    (path,) = tune.find_numbers(document, ["speed"])
    its = engine.Scene.model_validate(document)
    recorded = tune.read_recorded(60, lambda key, velocity: render_note(key, velocity, seconds_needed(velocity), its))
    fast = tune.change_numbers(document, [path], np.log([2.0]))
    (fitted,) = tune.fit(fast, [path], [recorded])
    assert tune.value_at(fitted, path) == pytest.approx(tune.value_at(document, path), rel=0.3)
    with pytest.raises(ValueError, match="no shared body lid"):
        tune.find_numbers(document, ["lid.density"])
    with pytest.raises(ValueError, match="no positive number"):
        tune.find_numbers(document, ["nothing"])
