"""Results of steps that are repeated with the same inputs."""

import hashlib
import pickle
from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["KeptResults"]

_Result = TypeVar("_Result")


class KeptResults:
    """The newest result of each step, found by everything that the step depends on.

    Attributes
    ----------
    watch : callable
        Called with what is found before the end.
    """

    def __init__(self) -> None:
        self.watch: Callable[..., None] = lambda *_: None
        self._held: dict[str, tuple[bytes, Any]] = {}

    def once(self, step: str, inputs: object, compute: Callable[[], _Result]) -> _Result:
        """Return the result of a step; compute it if its inputs are not those of the last time.

        Parameters
        ----------
        inputs : object
            Numbers, names, arrays and dataclasses of them, compared by content.
        compute : callable
            Depends on nothing else. Its result must not be changed by whoever gets it.
        """
        key = hashlib.sha256(pickle.dumps(inputs)).digest()
        held = self._held.get(step)
        if held is None or held[0] != key:
            # release the old result before the new one is made
            self._held.pop(step, None)
            held = key, compute()
            self._held[step] = held
        result: _Result = held[1]
        return result
