"""Does a test notice? Each mutant is one slip in a copy of the project; a test must fail on it (`make mutants`).

    python tests/mutants.py                 all of them, some ten minutes
    python tests/mutants.py gravity wings   those whose names contain one of these words

Kernels with a slip run as plain Python, which is faster than to compile them all again. The exit code is 1 if a mutant
survives or cannot be made.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from aerobat_pin.numerics.jit import sources_stamp

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("aerobat_description", "aerobat_pin", "docs", "examples", "tests", "pyproject.toml")  # all that tests read
KERNEL_SOURCES = {name for name, _, _ in sources_stamp()}
LONGEST = 600  # [s] for the tests of one mutant


class Mutant(NamedTuple):
    """A slip: its name, the file in `aerobat_pin`, the text and what replaces it, and the tests that should notice."""

    name: str
    file: str
    text: str
    slip: str
    tests: str


RESIDUAL, OBSERVERS = "observers/kernels/residual.py", "tests/observers/test_observers.py"
RECORDINGS = "tests/estimation/test_recordings.py"
CALIBRATIONS = "tests/estimation/test_map_calibration.py"
KERNELS, TWINS = "flight/plant/kernels.py", "tests/flight/test_plant_kernels.py::test_one_instant_of_the_plant"
ELASTIC = "tests/flight/test_changed_plant.py::test_four_elastic_joints_fly_as_in_mujoco"
MUTANTS = (
    Mutant("gears behind the coupling of encoders", "records/joint_channels.py", "len(joints)) * factor",
           "len(joints)) * np.array(factor)[:, None]", "tests/estimation/test_maps.py"),
    Mutant("efforts of encoders as velocities", "records/joint_channels.py",
           "np.linalg.inv(A[np.ix_(has_effort, has_effort)]).T", "np.linalg.inv(A[np.ix_(has_effort, has_effort)])",
           "tests/estimation/test_maps.py"),
    Mutant("a joint the other way keeps its rate", "estimation/checks/readings.py",
           "self.sense * values[:, at_v[order]]", "values[:, at_v[order]]",
           "tests/estimation/test_explained_efforts.py"),
    Mutant("a known force is always as mapped", "estimation/checks/efforts.py",
           "changes += changes_of_known(record, instants, rows, without)", "pass",
           "tests/estimation/test_misread.py"),
    Mutant("what motors differ by is a wrong unit", "estimation/checks/changes.py", "OWN = 1.25", "OWN = 1.1",
           "tests/estimation/test_explained_efforts.py"),
    Mutant("another size of one component leaves the others' equations", "observers/expected.py",
           "n, M = n - along * n[:, j, None], M", "n, M = n, M", "tests/observers/test_expected.py"),
    Mutant("a leg the other way keeps its effort", "estimation/checks/readings.py",
           "reading.otherwise(group, 0.0, -1.0, -1.0)", "reading.otherwise(group, 0.0, -1.0, 1.0)",
           "tests/estimation/test_misread.py"),
    Mutant("legs in another order keep their turns", "estimation/checks/readings.py",
           "order[k] = self.order[other]", "order[k] = k", "tests/estimation/test_misread.py"),
    Mutant("a base may weigh next to nothing", "estimation/checks/free_efforts.py",
           "other[0][n] > -LIGHTEST and ", "", "tests/estimation/test_misread.py tests/estimation/test_legs.py"),
    Mutant("too many factors silence one of all", "estimation/checks/efforts.py", "default=0.0) < MOST_OF_IT * gain",
           "default=0.0) >= 0.0", "tests/estimation/test_explained_efforts.py"),
    Mutant("a contained change counts as much", "estimation/checks/efforts.py",
           "max([ENOUGH, *(gains_of.get(case, ENOUGH) for case in change.cases)])", "ENOUGH",
           "tests/estimation/test_explained_efforts.py"),
    Mutant("moment lever dropped", "observers/applications.py", "MOMENT_ARM, 1.0)", "1.0, 1.0)",
           "tests/observers/test_applications.py"),
    Mutant("power row not normalised", "observers/rows.py",
           "np.divide(joints, speed, out=np.zeros_like(joints), where=speed > 0.0)", "joints",
           "tests/observers/test_rows.py"),
    Mutant("errors of rows at rest as in motion", "observers/kalman/learning.py", "(1.0 - sliding * sliding))",
           "(1.0 - sliding))", "tests/observers/test_kalman.py"),
    Mutant("rows not weighted", "observers/rows.py",
           "self.weight: Array = np.where(forces, 1.0, 1.0 / MOMENT_ARM)", "self.weight: Array = np.ones(len(forces))",
           "tests/observers"),
    Mutant("C^T v left out", RESIDUAL, "dot(C[:, i], v) - g[i, 0]", "-g[i, 0]", OBSERVERS),
    Mutant("C for its transpose", RESIDUAL, "dot(C[:, i], v)", "dot(C[i, :], v)", OBSERVERS),
    Mutant("sign of gravity in the observer", RESIDUAL, "dot(C[:, i], v) - g[i, 0]", "dot(C[:, i], v) + g[i, 0]",
           OBSERVERS),
    Mutant("rectangle for trapezoid", RESIDUAL, "0.5 * (before[1, i] + after[1, i])", "before[1, i]",
           "tests/observers/test_momentum_equations.py"),
    Mutant("p0 omitted", RESIDUAL, "(after[0, i] - before[0, i]) / dt", "after[0, i] / dt", OBSERVERS),
    Mutant("tau one sample late", "observers/momentum_equations.py", "mean_residuals(samples, time, u)\n    v",
           "mean_residuals(samples, time, np.roll(u, 1, axis=0))\n    v", "tests/observers/test_momentum_equations.py"),
    Mutant("body for world axes in the observer", RESIDUAL, "if turns > 0.0:", "if turns <= 0.0:",
           "tests/observers/test_applications.py"),
    Mutant("Jacobian at the start", RESIDUAL, "0.5 * (before[3 + row, i] + after[3 + row, i])", "before[3 + row, i]",
           "tests/observers/test_momentum_equations.py"),
    Mutant("Euler for the exact filter", "observers/kernels/filters.py", "decay = np.exp(-gain * dt)",
           "decay = 1.0 - gain * dt", OBSERVERS),
    Mutant("sign of gravity of the robot", "aerobat/aerobat.py", "np.array([0.0, 0.0, -gravity])",
           "np.array([0.0, 0.0, gravity])", "tests/aerobat/test_identities.py tests/flight/test_flights.py"),
    Mutant("wings swapped in the robot", "aerobat/aerobat.py",
           '("left_shoulder", "left_elbow", "right_shoulder", "right_elbow")',
           '("right_shoulder", "right_elbow", "left_shoulder", "left_elbow")', "tests/flight/test_csv_log.py"),
    Mutant("wings swapped in the air", "aerobat/wing.py", "np.where(y >= 0.0, panel, panel + 2)",
           "np.where(y <= 0.0, panel, panel + 2)", "tests/aerodynamics/test_robot_air.py"),
    Mutant("wings swapped in the scores", "aerobat/flight_log.py", "for point in points]",
           "for point in points[::-1]]", "tests/estimation/test_verdict.py"),
    Mutant("body for world axes in the plant", KERNELS, "if axes != 2:", "if axes == 1:", TWINS),
    Mutant("added mass dropped", KERNELS, "    add_mass(robot.added_mass, tree, results, robot.links, H, h)\n", "",
           "tests/aerodynamics/test_added_mass.py"),
    Mutant("elastic joints do not push each other", KERNELS, "A[at, unknowns + f] = H[row, row_of[plant.elastic[f]]]",
           "A[at, unknowns + f] = H[row, row] if f == e else 0.0", ELASTIC),
    Mutant("deflection departs from the wrong stage", KERNELS, "departed_by[DEPARTURES[stage], e]", "departed_by[0, e]",
           ELASTIC),
    Mutant("unknown force not in the motion", KERNELS, "aerodynamic[i] + thrusters[i] + pushed[i] - h[i]",
           "aerodynamic[i] + thrusters[i] - h[i]", TWINS),
    Mutant("known aerodynamic force dropped", "aerobat/robot.py",
           "dict(reconstructed_air(self.aerobat, self.air, Motion.of(block)))", "{}", "tests/estimation"),
    Mutant("added mass not told to the observer", "aerobat/air/believed_air.py",
           '        forces["added_mass"] = added\n', "        pass\n", "tests/estimation/test_aerobat_logs.py"),
    Mutant("step's sign", "scenario/unknown_forces.py", "_tick_integral(self.step", "_tick_integral(-self.step",
           "tests/scenario/test_unknown_forces.py tests/experiments/test_paper_experiment.py"),
    Mutant("nose down counted up", "observers/frames.py", "np.arctan2(R[:, 2, 0], up)", "np.arctan2(-R[:, 2, 0], up)",
           "tests/estimation/test_verdict.py"),
    Mutant("downwash upward", "aerodynamics/lifting_line.py", "w = normal_velocity - self.downwash @ circulation",
           "w = normal_velocity + self.downwash @ circulation", "tests/aerodynamics/test_lifting_line.py"),
    Mutant("recorder's stamps for the sensors'", "records/bag_columns.py",
           'stamped if self._chosen == "header" and self._stamped else arrival', "arrival", RECORDINGS),
    Mutant("w first read as w last", "records/axes.py", "np.roll(turns, -1, axis=1)", "turns",
           RECORDINGS),
    Mutant("delay of a command on the wrong side", "records/channels.py",
           "-known.delay if known.powers", "known.delay if known.powers", RECORDINGS),
    Mutant("a load cell's sign dropped", "forces/known_forces.py",
           "values = section.sign * (", "values = (", RECORDINGS),
    Mutant("what joints may hold at rest hides a change", "estimation/calibration/check_model.py",
           "float(np.mean(part.near**2))", "part.check.ratio**2", "tests/estimation/test_strange_arm.py"),
    Mutant("a learnt mass dropped", "estimation/calibration/calibration.py",
           "else robot.heavier(self.fitted.mass)", "else robot", CALIBRATIONS),
    Mutant("the share of the air dropped", "forces/learnt_error.py",
           "self.share * condition.doubted_force(known)", "0.0", "tests/estimation/test_calibration.py"),
    Mutant("one number for two dimensions", "records/netcdf.py",
           "next(numbers)", "len(scales)", "tests/flight/test_flight_log.py"),
    Mutant("steering late instead of ahead", "control/controller.py", "(1.0 - 1j * self._crank_rate * believed.lag)",
           "(1.0 + 1j * self._crank_rate * believed.lag)", "tests/control/test_controller.py"),
    Mutant("swing not in the reference", "control/law.py", "    add_waves(law.swing, crank_angle, reference)\n", "",
           "tests/control/test_controller.py"),
    Mutant("a row to spare tests every component", "forces/row_errors.py",
           'np.einsum("mic,mi->c", shares, spare) / len(J)', "np.full(J.shape[1], spare.mean())",
           "tests/estimation/test_row_errors.py"),
    Mutant("a world whose z points down keeps it", "estimation/checks/known_against_motion.py",
           "attitude = np.where(worlds[:, None, None, None], turns", "attitude = np.where(False, turns",
           "tests/estimation/test_flying_arm.py"),
    Mutant("a push elsewhere is a wrong effort", "estimation/checks/efforts.py",
           "all(part > change.price for part in parts)", "True", "tests/estimation/test_explained_efforts.py"),
    Mutant("a start that rises counts as a push", "forces/pushes.py", "> estimate.risen - 1e-9",
           "> -1.0", "tests/estimation/test_verdict.py"),
)  # fmt: skip


def verdict(copy: Path, mutant: Mutant) -> str:
    """Make a mutant in a copy of the project; return `killed ...`, `survived`, or why it could not be tried."""
    path = copy / "aerobat_pin" / mutant.file
    source = path.read_text(encoding="utf-8")
    if source.count(mutant.text) != 1:
        return f"cannot be made: {source.count(mutant.text)} places in {mutant.file} have this text, one was expected"
    path.write_text(source.replace(mutant.text, mutant.slip), encoding="utf-8")
    words = [word.partition("::") for word in mutant.tests.split()]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rf", "-p", "no:randomly", "-p", "no:cacheprovider"]
    command += [file for file, _, _ in words] + [part for _, _, start in words if start for part in ("-k", start)]
    environment = {**os.environ, "PYTHONPATH": str(copy), "NUMBA_DISABLE_JIT": str(int(mutant.file in KERNEL_SOURCES))}
    try:
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return "killed: the tests do not end"
    if done.returncode == 1:
        failed = [line.split()[1] for line in done.stdout.splitlines() if line.startswith("FAILED ")]
        return f"killed by {failed[0] if failed else 'an error in the tests'}"
    return "survived" if done.returncode == 0 else f"cannot be tried: {done.stdout.strip()[-300:]}"


def main(words: list[str]) -> int:
    """Try the mutants, print a line for each, and return the exit code."""
    chosen = [mutant for mutant in MUTANTS if not words or any(word in mutant.name for word in words)]
    alive = 0
    for mutant in chosen:
        with tempfile.TemporaryDirectory() as folder:  # a copy for each, which takes the compiled kernels with it
            for name in COPIED:
                (shutil.copytree if (ROOT / name).is_dir() else shutil.copy2)(ROOT / name, Path(folder) / name)
            found = verdict(Path(folder), mutant)
        alive += not found.startswith("killed")
        print(f"{mutant.name:<38} {found}", flush=True)
    print(f"{len(chosen) - alive} of {len(chosen)} killed")
    return int(alive > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
