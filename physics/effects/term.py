"""An effect at work: a law with values for its parameters, in all of a batch or in some."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import EllipsisType

from physics.arrays import Number
from physics.effects.base import Effect

__all__ = ["Term"]


@dataclass(frozen=True)
class Term:
    """An effect with the values of its parameters.

    Attributes
    ----------
    effect : Effect
    values : mapping of str to Number
        A number each, or arrays that broadcast with the members of the batch it acts in.
    where : slice or Ellipsis
        Members along the batch's first axis in which the effect acts; Ellipsis: in all.
    """

    effect: Effect
    values: Mapping[str, Number]
    where: slice | EllipsisType = ...

    @property
    def flies(self) -> bool:
        """Whether it puts a force on the ball in flight."""
        return "force" in self.effect.hooks

    @property
    def brakes(self) -> bool:
        """Whether it puts a torque on the pendulum."""
        return "torque" in self.effect.hooks

    @property
    def alters_contact(self) -> bool:
        """Whether it changes what the contact hands over."""
        return "contact" in self.effect.hooks

    @property
    def alters_start(self) -> bool:
        """Whether it changes where the pendulum starts from."""
        return "start" in self.effect.hooks
