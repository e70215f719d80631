"""Every feature that keeps an estimate honest, on five sources: shown there, or not applicable for a stated reason."""

import pytest
from support import small_recordings

from aerobat_pin import calibrate, estimate, load_scenario, open_record
from aerobat_pin.aerobat import AerobatRobot, believed_robot, table_record
from aerobat_pin.estimation import Calibration, Result
from aerobat_pin.experiments import check_record, run

SOURCES = ("Aerobat simulated", "Aerobat's table", "an arm by map", "a quadruped's bag", "a drone by map")
ONE_CONTACT = "a walk has no stretch without contact, and nothing can be learnt from it"
NO_EFFORT = "it measures no effort, so that there is nothing to balance"
NO_SENSOR = "the table has neither a true force nor a force sensor"
NO_PHASE = "it has no phase"
NO_SPARE_ROW = "3 rows have no redundancy for the forces sought"
FIXED = "its base is fixed and its joints have positions alone: no series is measured twice"
NOT: dict[str, dict[str, str]] = {  # feature -> source -> why it has nothing to show there
    "agreements": {SOURCES[2]: FIXED},
    "balance": {SOURCES[4]: NO_EFFORT},
    "redundancy verdict": {SOURCES[2]: NO_SPARE_ROW, SOURCES[4]: NO_SPARE_ROW},
    "scores": {SOURCES[1]: NO_SENSOR, SOURCES[4]: NO_SENSOR},
    "contacts": {SOURCES[3]: ONE_CONTACT},
    "error bar": {SOURCES[3]: ONE_CONTACT},
    "friction": {SOURCES[3]: ONE_CONTACT, SOURCES[4]: "it has no joints"},
    "thrust": dict.fromkeys(SOURCES[:2], "its thrusters' forces are channels")
    | dict.fromkeys(SOURCES[2:4], "it has no commands of thrust"),
    "parameters": {SOURCES[3]: ONE_CONTACT, SOURCES[4]: "its mass is what its thrust is fitted with"},
    "series over a phase": {SOURCES[2]: NO_PHASE, SOURCES[3]: f"{NO_PHASE}, and {ONE_CONTACT}", SOURCES[4]: NO_PHASE},
}


def has(result: Result, learnt: Calibration | None, found_again: list[bool]) -> dict[str, bool]:
    """Return feature -> whether a source has it filled."""
    checks, observers = [finding.check for finding in result.findings], result.observers.values()
    return {
        "agreements": any(" against " in check and not check.startswith(("effort", "sensor")) for check in checks),
        "balance": "effort against motion" in checks,
        "clocks": any(check.startswith("rate of ") for check in checks),
        "redundancy verdict": all(one.redundancy.verdict != "blind" for one in observers),
        "deviations": any(one.deviation is not None for one in observers),
        "contacts": result.calibration is not None and result.calibration.contacts is not None,
        "error bar": learnt is not None and bool(learnt.error_bar),
        "friction": learnt is not None and learnt.fitted.friction is not None,
        "thrust": learnt is not None and bool(learnt.fitted.coefficients),
        "parameters": learnt is not None and (learnt.identified is not None or learnt.fitted.mass != 1.0),
        "series over a phase": learnt is not None and learnt.series is not None,
        "scores": all(result.compared.values()),
        "self-check": bool(found_again) and all(found_again),
    }


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bool]]:
    """Source -> what it has; where something is free, the other record is estimated with what it taught."""
    folder = tmp_path_factory.mktemp("sources")
    for write in (small_recordings.write_arm, small_recordings.write_walk, small_recordings.write_drone):
        write(folder)
    small_recordings.write_hall(folder)
    names = "observers.names=['momentum','kalman']"
    free = load_scenario("paper", ["unknown_force=[]", "simulation.duration=1.0", names])
    robot, section = AerobatRobot.of(believed_robot(free), free.believed_air, "measured"), free.observers
    taught = {"harmonics": 2, "parameters": ["friction", "com_x"]}
    hall = calibrate([table_record(folder / "hall_free.csv", robot, section)], **taught)
    paper = load_scenario("paper", ["simulation.duration=0.5", "observers.names=['momentum','kalman']"])
    flight = run(paper, calibration=hall)
    table = table_record(folder / "hall.csv", robot, section)
    arm_free = open_record(folder / "arm_free.csv", folder / "arm.toml")
    arm = open_record(folder / "arm.csv", folder / "arm_fit.toml")
    swing = calibrate([arm_free], parameters=["mass"])
    walk = open_record(folder / "walk", folder / "walk_bag.toml")
    wind, calm = (open_record(folder / f"{name}.csv", folder / "drone.toml") for name in ("drone_wind", "drone"))
    still = calibrate([calm])
    records = (table, arm, walk, wind)
    results = [
        flight.scores,
        *(estimate(one, (), learnt) for one, learnt in zip(records, (hall, swing, None, still), strict=True)),
    ]
    found = [[one.ok for one in check_record(record)] for record in (results[0].record, *records)]
    gave = zip(SOURCES, results, (hall, hall, swing, None, still), found, strict=True)
    return {name: has(*each) for name, *each in gave}


@pytest.mark.parametrize("source", SOURCES)
def test_a_feature_is_shown_or_does_not_apply(shown: dict[str, dict[str, bool]], source: str) -> None:
    """A reason stands only where there is really nothing."""
    lacking = {feature for feature, there in shown[source].items() if not there}
    assert lacking == {feature for feature, reasons in NOT.items() if source in reasons}
