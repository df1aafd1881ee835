"""Actions as given, before an environment acts on them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces


def checked_action(space: spaces.Space[Any], action: Any) -> Any:
    """Return an action of the space, arrays as a copy; raise `ValueError` for any other.

    Floats of any precision will do and keep theirs. A copy, since environments hand the action
    on in `info`, and callers may use their array again.
    """
    if isinstance(space, spaces.Box):
        given = np.array(action)
        # A box would warn about what is no array before it says no.
        if given.dtype.kind in "iuf" and space.contains(given.astype(space.dtype)):
            return given
    elif space.contains(action):
        return action
    raise ValueError(f"action {action!r} lies outside the action space {space}")
