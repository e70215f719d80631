"""The table `observers.raw`: what `smoother` and `kalman` assume of raw samples."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from aerobat_pin.scenario.section import NonNegative, PerWorldAxis, Positive, Section, Whole


class RawNoiseSection(Section):
    """Deviations of raw samples; a value that is left out is the one noted in the log, else that of a good sensor."""

    position: Positive | None = Field(None, description="of motion capture, each world axis; else 1 mm [m]")
    orientation: Positive | None = Field(None, description="of motion capture, about body axes; else 3 mrad [rad]")
    gyro: Positive | None = Field(None, description="else 3 mrad/s [rad/s]")
    accelerometer: Positive | None = Field(None, description="else 0.05 m/s2 [m/s2]")
    crank: Positive | None = Field(None, description="else a 4096th of a turn over sqrt(12) [rad]")
    torque: Positive | None = Field(None, description="else 0.5 mN m [N m]")


class RawSection(Section):
    """What `smoother` and `kalman` assume of raw samples; see `aerobat_pin.estimation.raw`."""

    walk: PerWorldAxis | None = Field(
        None, description="change of each force in a second, world x, y, z; left out: by likelihood [N/sqrt(s)]"
    )
    bend: PerWorldAxis | None = Field(
        None, description="change of each force's slope in a second, world x, y, z; left out: by likelihood [N/s^1.5]"
    )
    alike: PerWorldAxis | None = Field(
        None, description="common changes of the forces over those in which they differ; left out: by likelihood [-]"
    )
    crank_jerk: Positive | None = Field(
        None, description="white noise of the crank's jerk; left out: by likelihood [rad/s^2.5]"
    )
    white: PerWorldAxis | None = Field(
        None, description="noise of each force, mean over 1 ms, world x, y, z; left out: by likelihood [N]"
    )
    mass_error: NonNegative = Field(0.0, description="deviation of the mass's factor, which is estimated; 0 trusts [-]")
    air_error: NonNegative = Field(0.0, description="deviation of the air's factor, which is estimated; 0 trusts [-]")
    offset_error: NonNegative = Field(
        2.0e-3, description="deviation of the clock offsets that are looked for; 0 looks for none [s]"
    )
    apply_offsets: bool = Field(False, description="whether clock offsets that are found are applied")
    iterations: Annotated[Whole, Field(ge=1, le=20)] = Field(8, description="linearisations of the record, at most")
    noise: RawNoiseSection = RawNoiseSection()
