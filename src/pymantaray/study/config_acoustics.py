"""Sections of a configuration about sound: its rays, how it is timed, and whether it is heard."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pymantaray.study.section import NonNegativeFloat, PositiveFloat, Section

Bounces = Annotated[int, Field(ge=0, le=15, description="what the solver can count")]


class AcousticsSection(Section):
    """How eigenrays are looked for, which of them is ranged on, and whether the current carries them."""

    spreading_cutoff_db: PositiveFloat | Literal["off"] = 15.0
    interpolation: Literal["smooth", "linear"] = "smooth"
    max_surface_bounces: Bounces = 0
    max_bottom_bounces: Bounces = 0
    arrival: Literal["direct", "first", "strongest"] = "direct"
    currents: bool = False

    @property
    def cutoff_db(self) -> float | None:
        """The spreading cut-off as `find_eigenrays` takes it, None for off. [dB]."""
        return None if self.spreading_cutoff_db == "off" else float(self.spreading_cutoff_db)


class RangingSection(Section):
    """
    How travel times are measured; the paper has synchronous clocks, one way, and a fleet at rest.

    With ``mistaken`` the receiver does not know the direct arrival from the others: it takes the first or the
    strongest that it detects, by ``[detection]`` or, without, by a threshold below the link's strongest arrival.
    """

    timing: Literal["one-way", "two-way"] = "one-way"
    turn_around_s: NonNegativeFloat = 0.0
    clock_offset_sigma: NonNegativeFloat = 0.0
    clock_skew_sigma: NonNegativeFloat = 0.0
    mistaken: Literal["off", "first-detected", "strongest-detected"] = "off"
    below_strongest_db: NonNegativeFloat | None = None

    @model_validator(mode="after")
    def _only_two_way_turns_around(self) -> Self:
        if self.timing == "one-way" and self.turn_around_s > 0.0:
            raise ValueError(
                f"turn_around_s is {self.turn_around_s:g} s, but timing is one-way, where nobody answers;"
                ' leave it out or set timing = "two-way"'
            )
        return self

    @model_validator(mode="after")
    def _only_the_first_needs_a_threshold(self) -> Self:
        if self.below_strongest_db is not None and self.mistaken != "first-detected":
            raise ValueError(
                f"below_strongest_db is {self.below_strongest_db:g}, but mistaken is {self.mistaken}, which has no"
                ' use for it; leave it out or set mistaken = "first-detected"'
            )
        return self


class DetectionSection(Section):
    """
    The modems' sonar equation; without this section every arrival is heard, as in the paper.

    Levels are in dB re 1 µPa, the source's at 1 m and in the band. Noise is Wenz's, by wind and shipping (0.5
    if not given), unless its spectral level is given, in dB re 1 µPa²/Hz.
    """

    source_level_db: float
    frequency_hz: PositiveFloat
    bandwidth_hz: PositiveFloat
    wind_speed: NonNegativeFloat = 5.0
    shipping: float | None = Field(default=None, ge=0.0, le=1.0)
    noise_spectral_level_db: float | None = None
    processing_gain_db: float = 0.0
    threshold_db: float = 10.0
    spread_db: NonNegativeFloat = 6.0
    absorption: Literal["francois-garrison", "ainslie-mccolm", "thorp", "none"] = "francois-garrison"
    surface_loss: Literal["none", "bubbles", "coherent"] = "none"
    sediment: Literal["none", "clay", "silt", "sand", "gravel", "moraine"] = "none"

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.bandwidth_hz >= 2.0 * self.frequency_hz:
            raise ValueError(
                f"bandwidth_hz is {self.bandwidth_hz:g}, but frequency_hz, the middle of the band, is"
                f" {self.frequency_hz:g}: the band would begin below 0 Hz; it must be less than twice that"
            )
        if self.noise_spectral_level_db is not None and self.shipping is not None:
            raise ValueError(
                "shipping and noise_spectral_level_db exclude each other: one makes the noise, the other gives it"
            )
        return self


def check_mistaken(
    acoustics: AcousticsSection, ranging: RangingSection, detection: DetectionSection | None
) -> None:
    """
    Check that sections fit together about arrivals taken for the direct one.

    Parameters
    ----------
    acoustics : AcousticsSection
    ranging : RangingSection
    detection : DetectionSection or None

    Raises
    ------
    ValueError
        If they do not; pydantic makes a finding of it.
    """
    if ranging.mistaken == "off":
        return
    if acoustics.arrival != "direct":
        raise ValueError(
            f"ranging.mistaken is {ranging.mistaken}, but acoustics.arrival is {acoustics.arrival}: what is taken for the"
            " direct arrival has no meaning there; leave one of them out"
        )
    if ranging.mistaken == "first-detected" and detection is None and ranging.below_strongest_db is None:
        raise ValueError(
            "ranging.mistaken is first-detected, but nothing says what is detected; add [detection] or"
            " ranging.below_strongest_db, such as 12.0"
        )
    if detection is not None and ranging.below_strongest_db is not None:
        raise ValueError(
            "ranging.below_strongest_db and [detection] exclude each other: both say what is detected; leave one out"
        )
