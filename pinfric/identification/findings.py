"""Result of an identification, without writing or showing it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from pinfric.identification.advice import Advice, advise
from pinfric.identification.estimate import Estimate
from pinfric.identification.laws import Law
from pinfric.identification.misfit import Misfit
from pinfric.identification.motor_constant import EffortFactor
from pinfric.identification.parameters import Parameter
from pinfric.identification.recordings import Recording
from pinfric.identification.rest import RestBound
from pinfric.model.arrays import FloatArray
from pinfric.model.described import EFFORT, derived, described, quantity
from pinfric.model.scene import Scene


@described
class HeldOut:
    """Error of a joint's predicted effort on held-out data, behind the fit's low pass.

    Fitted rows slide, away from turning points; moving rows are all that move, these among them.
    """

    rms: float = quantity("RMS of the measured effort in fitted rows", EFFORT)
    error: float = quantity("RMS of measured less predicted in fitted rows", EFFORT)
    plain: float = quantity(
        "the same with Coulomb and viscous friction only; NaN: not computed", EFFORT
    )
    moving_rms: float = quantity(
        "RMS of the measured effort in all moving rows", EFFORT, "effort\nRMS"
    )
    moving_error: float = quantity("RMS of measured less predicted in all moving rows", EFFORT)
    reversal_rms: float = quantity(
        "RMS of the measured effort in moving rows up to 0.3 s after a reversal; NaN: none",
        EFFORT,
        default=float("nan"),
    )
    reversal_error: float = quantity(
        "RMS of measured less predicted by the identified scene in these rows",
        EFFORT,
        default=float("nan"),
    )

    @property
    @derived()
    def reversal_share(self) -> float:
        """The error in rows after reversals as a share of the measured effort there."""
        return self.reversal_error / self.reversal_rms if self.reversal_rms else float("nan")

    @property
    @derived(heading="error\nmoving", cell="{moving_share:percent}")
    def moving_share(self) -> float:
        """The error in all moving rows as a share of the measured effort there."""
        return self.moving_error / self.moving_rms if self.moving_rms else float("nan")

    @property
    @derived(heading="error\nin fitted\nrows", cell="{share:percent}")
    def share(self) -> float:
        """The error in fitted rows as a share of the measured effort there."""
        return self.error / self.rms if self.rms else float("nan")

    @property
    @derived(heading="times that\nof Coulomb\n+ viscous", cell="{of_plain:.2f}")
    def of_plain(self) -> float:
        """The error in fitted rows over that with Coulomb and viscous friction, or NaN."""
        return self.error / self.plain if self.plain else float("nan")


@dataclass(frozen=True)
class Findings:
    """Friction of a robot identified from logs.

    Attributes:
        scene: with the friction, and the links' inertias, that were found.
        laws: joint -> law, of the joints that slid and that the model explains.
        parameters: every coefficient in the scene's terms, with its interval.
        posterior: key -> (n,) draws in the scene's terms, correlated: a row is one robot.
        errors: joint -> error on blocks used neither to choose laws nor to fit.
        unseen: log -> joint -> error on logs that were held out as a whole.
        rest: joint -> what its holds show.
        spread: joint -> how much friction differs between logs, as a share; NaN with one log.
        delay: by which logged efforts lag behind the motion, s; a guess where it is vague.
        misfits: what residuals still depend on; intervals are widened for it.
        effort_factors: factors on efforts that a known payload shows.
        doubts: what contradicts the result.
        given: what the result rests on and efforts hardly check: scales, time stamps, zeros.
        notes: the doubts, what is given, then what was read, repaired, left out, and what the logs
            cannot show.
        estimate: rows and coefficients behind all this.
    """

    scene: Scene
    laws: Mapping[str, Law]
    parameters: tuple[Parameter, ...]
    posterior: Mapping[str, FloatArray]
    errors: Mapping[str, HeldOut]
    unseen: Mapping[str, Mapping[str, HeldOut]]
    rest: Mapping[str, RestBound]
    spread: Mapping[str, float]
    delay: float
    misfits: tuple[Misfit, ...]
    effort_factors: tuple[EffortFactor, ...]
    doubts: tuple[str, ...]
    given: tuple[str, ...]
    notes: tuple[str, ...]
    estimate: Estimate

    @property
    def keeps_inertias(self) -> bool:
        """Whether the links' inertias are the URDF's."""
        return self.estimate.question.inertias_stay

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """The logs that were fitted."""
        return tuple(log.recording for log in self.estimate.prepared)

    @cached_property
    def advice(self) -> tuple[Advice, ...]:
        """Recordings of 30 s each, the most informative one first; none of a robot that stands."""
        return () if self.estimate.question.floating else advise(self.estimate)

    def law_of(self, joint: str) -> str:
        """Return a joint's law in words; "not explained" where it has none."""
        return str(self.laws.get(joint, "not explained"))
