"""Records at times of their own: a pause is no time of theirs, and times of a map count as at even times."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.recorded import edited, recorded
from support.swinging_arm import HEAVIER, JOINTS, ROTOR, arm, arm_map, recording

from aerobat_pin.estimation import estimate
from aerobat_pin.forces import accelerations, fitted_by_map, settled, taken_as_free
from aerobat_pin.records import Record
from aerobat_pin.records.resample import neighbour_rates
from aerobat_pin.records.spool import Spool
from aerobat_pin.visualization.figures.record import draw_motion
from aerobat_pin.visualization.replay.flight_replay import replay_result

PAUSE = 90.0  # [s] after which the arm goes on


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pd.DataFrame]:
    """Return a folder with the arm, and 10 s of it that nothing pushed."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "arm.urdf").write_text(arm())
    recording(folder, "free", pushed=False, seed=1)
    return folder, pd.read_csv(folder / "free.csv")


def recorded_at(times: str, folder: Path, table: pd.DataFrame, **changes: Any) -> Record:
    """Return the record of a table at even times or its own."""
    return recorded(folder / "log.csv", edited(arm_map(), {"log.times": times, **changes}), table=table)


def check_fits(record: Record) -> None:
    """Check that the arm's mass and rotors are found."""
    values = fitted_by_map(taken_as_free(record), mass=True).values
    assert values.friction is not None
    assert values.mass == pytest.approx(HEAVIER, abs=0.002)
    np.testing.assert_allclose(values.friction.inertia, ROTOR, rtol=0.1)


def test_a_pause_is_no_time_of_a_record(table: tuple[Path, pd.DataFrame]) -> None:
    """Its rate, length, parts and fits are those of the samples; the mass was 1.2 times the believed one, not 1.06."""
    folder, whole = table
    stopped = whole.assign(t=whole.t + PAUSE * (whole.t >= 5.0))
    record = recorded_at("own", folder, stopped)
    assert (record.rate, record.duration) == pytest.approx((500.0, 9.996))
    assert [record.after_start(k) for k in (2499, 2499.5, 2500)] == pytest.approx([4.998, 49.999, 95.0])
    assert [record.index_after(time) for time in (4.998, 49.999, 95.0)] == pytest.approx([2499, 2499.5, 2500])
    assert list(record.spread(10_000, 1.0, 97.0)) == [(500, 2499), (2500, 3500)]
    risen = settled(record, record.times(0, 4999))
    np.testing.assert_array_equal(np.flatnonzero(~risen), [*range(25), *range(2500, 2525)])
    bands = [(band.get_x(), band.get_x() + band.get_width()) for band in draw_motion(record).get_axes()[0].patches]
    np.testing.assert_allclose(bands, [(0.0, 4.998), (95.0, 99.998)])
    rubbing = recorded_at("own", folder, stopped, **{"joints.friction": None})
    assert replay_result(estimate(rubbing, trust=True)).subtitle == "0 to 4.998 s; 9.996 s are used in all"
    check_fits(record)


@pytest.mark.parametrize("piece", [100, 1 << 16])
def test_steps_as_long_as_the_usual_ones_end_no_part(
    table: tuple[Path, pd.DataFrame], piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 10 samples a second, those of over 0.1 s did where pieces of a long recording meet; a real hole does."""
    monkeypatch.setattr("aerobat_pin.records.file_source.EXTENT", piece)
    folder, whole = table
    count = np.arange(450)
    slow = whole.iloc[10 * count].assign(t=0.1 * count + 0.02 * np.sin(count))
    record = recorded_at("own", folder, slow.drop(slow.index[230:234]))
    assert record.parts == ((0, 229), (230, 445))


def test_pauses_are_not_looked_for_among_all_others(
    table: tuple[Path, pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a record with 2000 of them it took 20 s to open it."""
    reads, read, (folder, whole) = list[int](), Spool.read, table
    monkeypatch.setattr(Spool, "read", lambda spool, place, numbers: (reads.append(place), read(spool, place, numbers)))
    record = recorded_at("own", folder, whole.assign(t=whole.t + 0.15 * (np.arange(len(whole)) // 20)))
    assert len(record.parts) == len(whole) // 20
    assert len(reads) < 50 * len(record.parts)


def test_channels_are_seen_between_the_stamps(table: tuple[Path, pd.DataFrame]) -> None:
    """As at even times, and beyond the last one; rows at the next stamps were given, and none beyond."""
    even, own = (recorded_at(times, *table) for times in ("even", "own"))
    for shift in (0.0005, 0.05):
        times = own.times(4000, 4999) + shift
        np.testing.assert_allclose(own.at("joints.effort", times), even.at("joints.effort", times), atol=1e-9)


def test_times_of_a_map_count_from_the_first_common_sample(table: tuple[Path, pd.DataFrame]) -> None:
    """Also where efforts begin later than positions: a stretch without contact was sought before they began."""
    folder, whole = table
    late = whole.assign(**{f"{joint}_i": whole[f"{joint}_i"].where(whole.t >= 6.0) for joint in JOINTS})
    changes = {"joints.friction": None, "use.free": [1.0, 3.0]}
    results = [estimate(recorded_at(times, folder, late, **changes), trust=True) for times in ("even", "own")]
    assert [result.start for result in results] == [6.0, 6.0]
    np.testing.assert_allclose(results[1].parts, results[0].parts, atol=1e-9)
    errors = [[f.value for f in result.findings if f.check == "stretch without contact"] for result in results]
    assert errors[0][0] is not None
    assert errors[0] == pytest.approx(errors[1], rel=0.01)


def test_accelerations_are_those_of_uneven_stamps(table: tuple[Path, pd.DataFrame]) -> None:
    """Of an arm that is logged at 100 Hz, then at 500 Hz; the mass was 1.2 times the believed one, without rotors."""
    folder, whole = table
    uneven = whole[(whole.index % 5 == 0) | (whole.t >= 5.0)]
    record = recorded_at("own", folder, uneven)
    block = record.block(*record.parts[0])
    true = np.gradient(whole[[f"{joint}_v" for joint in JOINTS]].to_numpy(), whole.t, axis=0)
    halves = 0.5 * (block.time[1:] + block.time[:-1])
    expected = np.column_stack([np.interp(halves, whole.t, column) for column in true.T])
    np.testing.assert_allclose(accelerations(block, record)[5:-5], expected[5:-5], atol=0.01)
    check_fits(record)


def test_samples_with_the_same_time_have_the_velocity_of_their_neighbours() -> None:
    """One that turns and flies steadily; it stood still for these samples, which looked like forces of 50 N."""
    model, v = pin.buildSampleModelHumanoidRandom(), np.linspace(-0.3, 0.4, 32)
    time = np.array([0.0, 0.0, 0.1, 0.3, 0.3, 0.3, 0.4, 0.4])
    q = np.array([pin.integrate(model, pin.neutral(model), t * v[: model.nv]) for t in time])
    np.testing.assert_allclose(neighbour_rates(model, time, q), np.tile(v[: model.nv], (8, 1)), atol=1e-12)
