"""Every effect with an id of its own, in every form of its law."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

from metrology import UsageError
from physics.effects.base import Effect
from physics.effects.flight import (
    AsymmetricWake,
    Buoyancy,
    DensityLapse,
    Drag,
    DragCrisis,
    Magnus,
    SpinDecay,
    Wind,
)
from physics.effects.impact import (
    MASS_ERROR,
    ContactDisplacement,
    EffectiveMass,
    ObliqueImpact,
    PivotRecoil,
    RubbingFace,
    SupportFriction,
    SupportRecoil,
    VelocityDependentCor,
)
from physics.effects.measurement import (
    OTHER_ROWS,
    PITCH,
    SHIFT,
    CameraRoll,
    DroppedFrames,
    LengthScale,
    LensDistortion,
    OriginOffset,
    Parallax,
    RollingShutter,
    TimeBase,
)
from physics.effects.swing import BackswingOffset, BearingFriction, PendulumDrag, ViscousDamping

__all__ = ["CATALOGUE", "MEASUREMENT_IDS", "effect_named"]

_ALL: tuple[Effect, ...] = (
    Drag(),
    DragCrisis(),
    DensityLapse(),
    Magnus(),
    SpinDecay(),
    Wind(),
    Buoyancy(),
    AsymmetricWake(),
    VelocityDependentCor(),
    EffectiveMass(),
    EffectiveMass(form="mass", parameters=(MASS_ERROR,)),
    ObliqueImpact(),
    ObliqueImpact(form="smooth face"),
    RubbingFace(),
    SupportFriction(),
    SupportFriction(form="until lift-off"),
    SupportFriction(form="ball alone"),
    ContactDisplacement(),
    ContactDisplacement(form="way alone"),
    PivotRecoil(),
    PivotRecoil(form="pendulum alone"),
    SupportRecoil(),
    SupportRecoil(form="of vertical speed"),
    SupportRecoil(form="constant"),
    SupportRecoil(form="whole velocity"),
    SupportRecoil(form="kick at release"),
    BearingFriction(),
    ViscousDamping(),
    PendulumDrag(),
    BackswingOffset(),
    TimeBase(),
    LengthScale(),
    LengthScale(form="about the start"),
    CameraRoll(),
    CameraRoll(form="ball only"),
    CameraRoll(form="about the start"),
    CameraRoll(form="about a point", parameters=(*CameraRoll().parameters, *SHIFT)),
    CameraRoll(form="three axes", parameters=(*CameraRoll().parameters, PITCH), axes=3),
    Parallax(),
    LensDistortion(),
    RollingShutter(),
    RollingShutter(form="ball only"),
    RollingShutter(form="other rows", parameters=(*RollingShutter().parameters, OTHER_ROWS)),
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
"""Ids that blame the instrument."""


def effect_named(name: str) -> Effect:
    """Give the usual form of an effect.

    Raises
    ------
    UsageError
        If there is no effect of that id; the message lists what there is.
    """
    if name not in CATALOGUE:
        raise UsageError(
            f"there is no effect {name!r}", hint=f"Known effects: {', '.join(CATALOGUE)}."
        )
    return CATALOGUE[name][0]
