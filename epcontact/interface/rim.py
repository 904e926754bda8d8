"""How the rim of a contact leads from the grid to the limit of a vanishing spacing."""

from __future__ import annotations

import math
from typing import NamedTuple

from epcontact.interface.limit import Limit


class Constants(NamedTuple):
    """Constants of the limit of a vanishing spacing."""

    sharp: float
    short: float  # d, in spacings
    chance: float  # claimed for the place of each link, in spacings
    area: float  # claimed for the place of all links, over the error that areas claim
    common: float  # claimed for d of all links alike, in spacings, where the rim is not straight


#: sharp and d of a straight rim along the grid; d is that of lines, `bem.areas.front`.
STRAIGHT = (2 * math.e / math.pi, 0.190009)
#: What a step of the surface adds to d, and to the claim.
STEP = (0.047, 0.068)
#: By `python -m laboratory.interface`; `common` by `laboratory.interface waves`, on
#: half of its scenes: of the others, with 32 to 128 shortest waves, 32 of 32 are
#: within, without it 25.
CONSTANTS = Constants(sharp=0.94, short=0.103, chance=0.54, area=1.75, common=0.015)
#: Of elastic contact beside points that flow, where only what is straight is moved.
SMOOTH = Constants(sharp=0.0, short=0.103, chance=0.82, area=1.08, common=0.0)


class Rim(NamedTuple):
    """What the limit needs to know of the rim of a contact; see the module."""

    release: float  # in m
    scatter: float  # root of the sum of the squares of its terms
    straight: float  # 0 for a rim of all directions, 1 for one along the grid
    offset: float  # in spacings
    doubt: float  # its error, as areas claim it
    stepped: (
        float  # 1 if the contact presses as a punch does there, 0 if a quarter less
    )
    flows: bool  # True if points that flow bound it


def limit_of(sinking: float, rim: Rim, constants: Constants | None = None) -> Limit:
    """Return k/E* of a punch that sinks by E* u = `sinking`, by its rim."""
    c = constants or (SMOOTH if rim.flows else CONSTANTS)
    sharp = c.sharp + (STRAIGHT[0] - c.sharp) * rim.straight
    short = c.short + STEP[0] * rim.stepped
    short += (STRAIGHT[1] - short) * rim.straight
    moved = sharp * (rim.offset + short) * rim.release / sinking
    alike = c.common * (1 - rim.straight)
    common = rim.release * math.hypot(c.area * rim.doubt, STEP[1] * rim.stepped, alike)
    limit = math.exp(moved) / sinking  # to first order, and positive on any grid
    return Limit(
        limit, 1 / sinking, limit * math.hypot(c.chance * rim.scatter, common) / sinking
    )
