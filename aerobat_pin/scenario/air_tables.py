"""The table of the air, with those inside it: gust, turbulence, waves."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from aerobat_pin.scenario.tables import NonNegative, Number, Positive, Section, Triple, Whole


class GustSection(Section):
    """A gust that is the same everywhere; over time its velocity rises and falls as (1 - cos) / 2."""

    amplitude: Triple = Field(description="largest velocity beside the wind, world axes [m/s]")
    start: Number = Field(0.5, description="of the gust [s]")
    duration: Positive = Field(0.5, description="of the gust [s]")


class WaveSection(Section):
    """A sine over time, the same everywhere: amplitude sin(2 pi frequency t + phase)."""

    amplitude: Triple = Field(description="velocity beside the wind, world axes [m/s]")
    frequency: Positive = Field(description="of the sine [Hz]")
    phase_deg: Number = Field(0.0, description="at t = 0 [deg]")


class TurbulenceSection(Section):
    """Turbulence with Dryden's spectra, the same everywhere; see `aerobat_pin.aerodynamics.wind`."""

    deviation: tuple[NonNegative, NonNegative, NonNegative] = Field(
        description="along world x, the direction of the flight, and across it, y and z [m/s]"
    )
    length: Positive = Field(1.0, description="scale of the eddies [m]")
    airspeed: Positive = Field(3.0, description="with which they are flown through [m/s]")
    seed: Whole = Field(1, ge=0, description="of the turbulence alone")


class AirSection(Section):
    """The air: density, wind, gust, turbulence, and the aerodynamic model of the wings."""

    density: Positive = Field(1.225, description="of the air [kg/m3]")
    model: Literal["lifting_line", "quasi_steady"] = Field("lifting_line", description="what the strips obey")
    added_mass: NonNegative = Field(
        1.0, description="factor of the wings' added mass; 1 is theory, 0 leaves it out [-]"
    )
    lift_limit: Positive | None = Field(None, description="largest lift coefficient of a strip of the lifting line [-]")
    wind: Triple = Field((0.0, 0.0, 0.0), description="velocity of the air, world axes [m/s]")
    gust: GustSection | None = None
    turbulence: TurbulenceSection | None = None
    wave: tuple[WaveSection, ...] = Field((), description="sines over time that are added")
    strips: Whole = Field(16, ge=2, le=200, description="strips over the full span")
    warm_up_cycles: Whole = Field(6, ge=0, description="flapping cycles flown with the body held before t = 0")

    @property
    def steady(self) -> AirSection:
        """This air with its steady wind alone."""
        return self.model_copy(update={"gust": None, "turbulence": None, "wave": ()})

    @property
    def is_steady(self) -> bool:
        """Whether the velocity of the air never changes."""
        speeds = [section.amplitude for section in (self.gust, *self.wave) if section is not None]
        return not any(map(any, speeds if self.turbulence is None else [*speeds, self.turbulence.deviation]))
