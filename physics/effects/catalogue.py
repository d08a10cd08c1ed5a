"""The catalogue of effects by id, in every form of their laws."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

from metrology import UsageError
from physics.effects.base import Effect, Form
from physics.effects.flight import (
    SPIN_ACROSS,
    WIND_ASIDE,
    WIND_UPWARD,
    AsymmetricWake,
    Buoyancy,
    DensityLapse,
    Drag,
    DragCrisis,
    DragThroughLayer,
    Magnus,
    RecoveringCrisis,
    SaturatingLift,
    SpinDecay,
    SpinDecayBySquare,
    Wind,
    WindOverFloor,
)
from physics.effects.impact import (
    MASS_ERROR,
    ContactArm,
    ContactDisplacement,
    EffectiveMass,
    FaceTurnedOnArm,
    ObliqueImpact,
    PivotRecoil,
    RubbingFace,
    SlidingSupport,
    SupportFriction,
    SupportRecoil,
    TurnedFace,
    VelocityDependentCor,
    ViscoelasticCor,
    YieldingCor,
)
from physics.effects.measurement import (
    CAMERA_ROTATION,
    FURTHER_TERM,
    ORIGIN_SHIFT,
    OTHER_ROWS,
    PITCH,
    PLANE_SLOPE,
    CameraRoll,
    DroppedFrames,
    LengthScale,
    LensDistortion,
    OriginOffset,
    Parallax,
    RollingShutter,
    TimeBase,
)
from physics.effects.swing import (
    BackswingOffset,
    BearingFriction,
    FallingBearing,
    GivingBearing,
    GivingFallingBearing,
    LoadedBearing,
    PendulumDrag,
    RollingDamping,
    StribeckBearing,
    ThinRodDrag,
    ViscousDamping,
)

__all__ = ["CATALOGUE", "MEASUREMENT_IDS", "effect_named"]

_ALL: tuple[Effect, ...] = (
    Drag(),
    DragThroughLayer(),
    DragCrisis(),
    RecoveringCrisis(),
    DensityLapse(),
    Magnus(),
    SaturatingLift(),
    Magnus(form=Form.SPIN_VECTOR, parameters=(*Magnus().parameters, *SPIN_ACROSS), axes=3),
    SaturatingLift(
        form=Form.SATURATING_VECTOR, parameters=(*Magnus().parameters, *SPIN_ACROSS), axes=3
    ),
    SpinDecay(),
    SpinDecayBySquare(),
    Wind(),
    WindOverFloor(),
    Wind(
        form=Form.ALONG_AND_UP,
        parameters=(*Wind().parameters, WIND_UPWARD),
        statement="The air itself moves: a steady draught in the plane, rising or sinking.",
        axes=2,
        planar=True,
    ),
    Wind(
        form=Form.FROM_ANY_SIDE,
        parameters=(*Wind().parameters, WIND_ASIDE),
        statement="The air itself moves: a steady draught from any side.",
        axes=3,
    ),
    Wind(
        form=Form.FROM_ANYWHERE,
        parameters=(*Wind().parameters, WIND_UPWARD, WIND_ASIDE),
        statement="The air itself moves: a steady draught from any side, rising or sinking.",
        axes=3,
    ),
    Buoyancy(),
    AsymmetricWake(),
    VelocityDependentCor(),
    YieldingCor(),
    ViscoelasticCor(),
    EffectiveMass(),
    EffectiveMass(form=Form.MASS, parameters=(MASS_ERROR,)),
    ContactArm(),
    ObliqueImpact(),
    ObliqueImpact(form=Form.SMOOTH_FACE),
    RubbingFace(),
    TurnedFace(),
    FaceTurnedOnArm(),
    SupportFriction(),
    SupportFriction(form=Form.UNTIL_LIFT_OFF),
    SupportFriction(form=Form.BALL_ALONE),
    SlidingSupport(),
    ContactDisplacement(),
    ContactDisplacement(form=Form.WAY_ALONE),
    PivotRecoil(),
    PivotRecoil(form=Form.PENDULUM_ALONE),
    SupportRecoil(),
    SupportRecoil(form=Form.OF_VERTICAL_SPEED),
    SupportRecoil(form=Form.CONSTANT),
    SupportRecoil(form=Form.WHOLE_VELOCITY),
    SupportRecoil(form=Form.KICK_AT_RELEASE),
    BearingFriction(),
    LoadedBearing(),
    StribeckBearing(),
    GivingBearing(),
    FallingBearing(),
    GivingFallingBearing(),
    ViscousDamping(),
    RollingDamping(),
    PendulumDrag(),
    ThinRodDrag(),
    BackswingOffset(),
    TimeBase(),
    LengthScale(),
    LengthScale(form=Form.ABOUT_THE_START),
    LengthScale(form=Form.ABOUT_A_POINT, parameters=(*LengthScale().parameters, *ORIGIN_SHIFT)),
    CameraRoll(),
    CameraRoll(form=Form.BALL_ONLY),
    CameraRoll(form=Form.ABOUT_THE_START),
    CameraRoll(form=Form.ABOUT_A_POINT, parameters=(*CameraRoll().parameters, *ORIGIN_SHIFT)),
    CameraRoll(
        form=Form.PERSPECTIVE,
        parameters=(*CameraRoll().parameters, *ORIGIN_SHIFT, *CAMERA_ROTATION),
        source="a pinhole camera turned about all its axes, first order in the angles",
        planar=True,
    ),
    CameraRoll(form=Form.THREE_AXES, parameters=(*CameraRoll().parameters, PITCH), axes=3),
    Parallax(),
    Parallax(form=Form.LEANING, parameters=(*Parallax().parameters, *PLANE_SLOPE)),
    LensDistortion(),
    LensDistortion(form=Form.TWO_TERMS, parameters=(*LensDistortion().parameters, FURTHER_TERM)),
    RollingShutter(),
    RollingShutter(form=Form.BALL_ONLY),
    RollingShutter(form=Form.OTHER_ROWS, parameters=(*RollingShutter().parameters, OTHER_ROWS)),
    OriginOffset(),
    DroppedFrames(),
)


_ALL = tuple(replace(effect, sharp=False) for effect in _ALL)


def _grouped(effects: Iterable[Effect]) -> Mapping[str, tuple[Effect, ...]]:
    groups: dict[str, tuple[Effect, ...]] = {}
    for effect in effects:
        groups[effect.id] = (*groups.get(effect.id, ()), effect)
    return MappingProxyType(groups)


CATALOGUE: Mapping[str, tuple[Effect, ...]] = _grouped(_ALL)
"""Effect id → its forms, the usual one first."""

MEASUREMENT_IDS = frozenset(e.id for e in _ALL if e.phase == "measurement")
"""Ids of measurement errors."""


def effect_named(name: str) -> Effect:
    """Return the usual form of an effect.

    Raises
    ------
    UsageError
        If there is no effect of that id; the message lists all.
    """
    if name not in CATALOGUE:
        raise UsageError(f"unknown effect {name!r}", hint=f"Known effects: {', '.join(CATALOGUE)}.")
    return CATALOGUE[name][0]
