"""Digests of tables: on each machine those that are committed, and others as soon as one number is another."""

import numpy as np
import pytest
from conftest import PATCHES

import engine
from bench.accuracy.machines import DEPENDS_ON_MACHINE
from engine.assembly.build import build
from engine.assembly.table_digest import digest_scene, digest_tables, read_shipped_digests

RATE = 44_100
SLOW = "scraped_stick", "sympathetic_strings", "toms"  # built in a second and more
NAMES = [path.stem for path in PATCHES]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.hard if name in SLOW else ())
        for name in NAMES
        if name not in DEPENDS_ON_MACHINE
    ],
)
def test_a_shipped_patch_has_the_committed_tables(name, patch):
    """After a change that is meant, `uv run python -m bench machines --write` writes them anew."""
    assert digest_scene(patch(name)) == read_shipped_digests()[name]


def test_all_shipped_patches_have_a_digest():
    digests = read_shipped_digests()
    assert list(digests) == NAMES and all(len(digest) == 16 for digest in digests.values())
    assert len({*digests.values()}) == len(digests)
    assert {*DEPENDS_ON_MACHINE} <= {*NAMES} and all(DEPENDS_ON_MACHINE.values())


@pytest.fixture
def built(patch):
    """The tables of a string and its hammer."""
    return build(patch("piano_c4"), RATE)


def digest_of(built) -> str:
    return digest_tables(built.model, built.state)


def test_a_digest_does_not_depend_on_where_arrays_lie(built, patch):
    again = build(patch("piano_c4"), RATE)
    assert again.state.q.ctypes.data != built.state.q.ctypes.data
    assert digest_of(again) == digest_of(built)


@pytest.mark.parametrize(
    "find",
    [
        lambda model, state: model.step.kick,
        lambda model, state: model.step.contact.rows.kick_phi,
        lambda model, state: model.flight.motion_low.qq,
        lambda model, state: model.pickups.gain,
        lambda model, state: model.pickups.channel,
        lambda model, state: model.islands.mode,
        lambda model, state: state.p,
        lambda model, state: state.exponent,
    ],
    ids=["kick", "kick at contacts", "rounding", "gain", "channel", "islands", "momentum", "exponent"],
)
def test_the_last_bit_of_any_number_changes_a_digest(built, find):
    before, array = digest_of(built), find(built.model, built.state)
    array[-1] = np.nextafter(array[-1], np.inf) if array.dtype.kind == "f" else array[-1] + 1
    assert digest_of(built) != before


def test_a_number_that_is_no_array_changes_a_digest(built):
    contact = built.model.contact._replace(tolerance=built.model.contact.tolerance * 1.5)
    assert digest_tables(built.model._replace(contact=contact), built.state) != digest_of(built)
    assert digest_tables(built.model._replace(sleep_threshold=0.5), built.state) != digest_of(built)


def test_the_type_and_the_name_of_an_array_change_a_digest(built):
    before, model = digest_of(built), built.model
    single = model._replace(step=model.step._replace(kick=model.step.kick.astype(np.float32)))
    swapped = model._replace(step=model.step._replace(kick=model.step.drift, drift=model.step.kick))
    as_columns = built.state._replace(p=built.state.p.reshape(-1, 1))
    assert len({before, *(digest_tables(one, built.state) for one in (single, swapped))}) == 3
    assert digest_tables(model, as_columns) != before


def test_the_sign_of_zero_and_the_kind_of_nan_do_not_count(built):
    before, q = digest_of(built), built.state.q
    assert np.any(q == 0.0)
    q[q == 0.0] = -0.0
    assert digest_of(built) == before
    bits = q.view(np.int64)
    bits[-1] = 0x7FF8_0000_0000_0000
    quiet = digest_of(built)
    bits[-1] = -0x0007_FFFF_FFFF_FEDC  # negative, with another payload
    assert np.isnan(q[-1]) and digest_of(built) == quiet != before


@pytest.mark.parametrize("name", ["bowed_vibraphone", "piano_c4"])
def test_free_slots_for_events_do_not_count(name, patch):
    few, many = (build(patch(name), RATE, event_capacity=capacity) for capacity in (8, 64))
    assert few.model.events.kind.size < many.model.events.kind.size
    assert digest_of(few) == digest_of(many)


def test_events_count(patch):
    built = build(patch("bowed_vibraphone"), RATE, event_capacity=8)
    before = digest_of(built)
    built.model.events.value[0] *= 1.5
    assert digest_of(built) != before


def test_how_islands_are_shared_among_cores_does_not_count(patch):
    scene = patch("felt_arpeggio")
    together, alone = build(scene, RATE), build(scene, RATE, one_partition_per_island=True)
    assert together.model.islands.partition.size < alone.model.islands.partition.size
    assert digest_of(together) == digest_of(alone)


@pytest.mark.parametrize("name", ["piano_c4", "bouncing_ball"])
def test_the_digest_is_among_the_statistics_of_a_rendering(name, patch):
    """That of the patch, though the ball is watched by a pickup of its own; tables that a trace or cores use too."""
    scene = patch(name)
    rendered = [engine.render(scene, 0.01, trace=trace, cores=cores) for trace, cores in [(False, 1), (True, 2)]]
    assert {one.stats.table_digest for one in rendered} == {digest_scene(scene)}
    assert rendered[0].stats.as_dict()["table_digest"] == digest_scene(scene)
    assert engine.render(scene, 0.01, samplerate=48_000).stats.table_digest != digest_scene(scene)
