"""The outline's normal equations: each sector's linear part solved and projected out.

All sums run over the pixels of one sector of one frame; the arrays carry (frame, sector, pixel).

Outlines fitted in several frames, as a table.

The ring of pixels about an outline, sorted into sectors of about four pixels of outline.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from vision.ball.outline.edges import Cutouts, EdgeProfile

__all__ = [
    "Equations",
    "OutlineFits",
    "Ring",
    "Sums",
    "Template",
    "joined",
    "linearised",
    "nothing_found",
    "panelled",
    "reduced",
]

FloatArray = NDArray[np.float64]

BoolArray = NDArray[np.bool_]

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class OutlineFits:
    """One row per frame.

    Attributes
    ----------
    found : (F,) bool array
        Whether there is an outline at all; the other rows mean nothing.
    centre : (F, 2) array
        Centre, px.
    radius : (F,) array
        Mean radius, px.
    covariance : (F, 2, 2) array
        Of the centre, px²; from the scatter that each sector of the outline shows.
    bound : (F, 2, 2) array
        Cramér–Rao bound of the same from noise and contrast alone, px².
    rms_residual : (F,) array
        Root mean square residual over noise.
    contrast : (F,) array
        Part of the sectors whose edge stands out from the noise, 0 to 1.
    normal : (F, 5, 5) array
        Normal matrix of centre, radius and ellipse at the solution, 1/px².
    pull : (F, 5) array
        What each of them is still pulled by there, 1/px.
    """

    found: BoolArray
    centre: FloatArray
    radius: FloatArray
    covariance: FloatArray
    bound: FloatArray
    rms_residual: FloatArray
    contrast: FloatArray
    normal: FloatArray
    pull: FloatArray

    def __len__(self) -> int:
        return len(self.found)

    def at(self, places: IntArray | BoolArray) -> "OutlineFits":
        """Some of the rows."""
        return OutlineFits(*(getattr(self, field.name)[places] for field in fields(self)))

    def put(self, places: IntArray | BoolArray, other: "OutlineFits") -> None:
        """Overwrite some of the rows."""
        for field in fields(self):
            getattr(self, field.name)[places] = getattr(other, field.name)


def nothing_found(count: int) -> OutlineFits:
    """A table of so many frames in which nothing was found yet."""
    return OutlineFits(
        np.zeros(count, dtype=bool),
        np.zeros((count, 2)),
        np.zeros(count),
        np.zeros((count, 2, 2)),
        np.zeros((count, 2, 2)),
        np.zeros(count),
        np.zeros(count),
        np.zeros((count, 5, 5)),
        np.zeros((count, 5)),
    )


def joined(parts: list[OutlineFits]) -> OutlineFits:
    """Tables one below the other."""
    return OutlineFits(
        *(
            np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(OutlineFits)
        )
    )


FloatImage = NDArray[np.float32]

# The ring is laid out about whole pixels; so far may a centre lie off its middle, px.
_SLACK = 0.8

_FEWEST_PIXELS = 24
"""Pixels of an outline: it has three unknowns and each of eight sectors three more."""

_FEWEST_IN_SECTOR = 5
"""Pixels of a sector: its light has three unknowns, two are to spare."""


@dataclass(frozen=True)
class Ring:
    """Pixels of several frames in sectors, padded to equal length.

    Attributes
    ----------
    x, y : (S, L) arrays
        Offsets from each frame's origin, px.
    origin : (F, 2) array
        Whole pixel about which each frame's ring was laid out, px.
    gray, background, inverse_noise : (F, S, L) float32 arrays
        As in `Cutouts`; the noise's inverse is 0 for pixels that do not count.
    size : (F, S) array
        Pixels that count; 0 in sectors with too few.
    enough : (F,) bool array
        Whether enough of the ring is in view.
    """

    x: FloatImage
    y: FloatImage
    origin: FloatArray
    gray: FloatImage
    background: FloatImage
    inverse_noise: FloatImage
    size: FloatArray
    enough: BoolArray

    def where(self, kept: BoolArray) -> "Ring":
        """Some of the frames."""
        if np.all(kept):
            return self
        return Ring(
            self.x,
            self.y,
            self.origin[kept],
            self.gray[kept],
            self.background[kept],
            self.inverse_noise[kept],
            self.size[kept],
            self.enough[kept],
        )

    def narrowed(self, sectors: BoolArray, parameters: FloatArray, inner: float) -> "Ring":
        """Without what lies further inside than `inner` in some sectors (F, S)."""
        away = (parameters[:, :2] - self.origin).astype(np.float32)[:, :, None, None]
        radius = parameters[:, 2].astype(np.float32)[:, None, None]
        depth = np.sqrt((self.x - away[:, 0]) ** 2 + (self.y - away[:, 1]) ** 2) - radius
        inverse = self.inverse_noise * ~(sectors[:, :, None] & (depth < -np.float32(inner)))
        size = np.count_nonzero(inverse, axis=2)
        good = size >= _FEWEST_IN_SECTOR
        return replace(
            self,
            inverse_noise=inverse * good[:, :, None],
            size=np.where(good, size, 0).astype(np.float64),
        )

    def moved(self, parameters: FloatArray) -> BoolArray:
        """Whether centres have left the middle of their ring."""
        away = np.abs(parameters[:, :2] - self.origin).max(axis=1)
        return np.asarray(away > _SLACK)


class Template:
    """Which pixels about a whole pixel make up the ring, the same for all frames.

    Parameters
    ----------
    radius : float
        Radius of the outline, px.
    inner, outer : float
        How far the ring reaches inside and outside, px.
    """

    def __init__(self, radius: float, inner: float, outer: float) -> None:
        self._inner, self._outer = np.float32(inner), np.float32(outer)
        self._reach = int(np.ceil(radius + outer + _SLACK))
        axis = np.arange(-self._reach, self._reach + 1)
        y, x = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
        rho = np.hypot(x, y)
        near = (rho > max(radius - inner - _SLACK, 0.5)) & (rho < radius + outer + _SLACK)
        x, y = x[near], y[near]
        count = int(np.clip(round(2 * np.pi * radius / 4.0), 6, 40))
        sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * count).astype(np.int64) % count
        order = np.argsort(sector, kind="stable")
        x, y, sector = x[order], y[order], sector[order]
        sizes = np.bincount(sector, minlength=count)
        place = np.arange(len(x)) - np.concatenate([[0], np.cumsum(sizes)[:-1]])[sector]
        self._x = np.zeros((count, int(sizes.max())), dtype=np.int64)
        self._y = np.zeros_like(self._x)
        self._real = np.zeros(self._x.shape, dtype=np.float32)
        self._x[sector, place], self._y[sector, place] = x, y
        self._real[sector, place] = 1.0
        # Padding stands on the ring too, where nothing is divided by nought.
        self._x[self._real == 0] = round(radius)
        self.size = self._x.size

    def gathered(self, cutouts: Cutouts, places: IntArray, parameters: FloatArray) -> Ring:
        """Pick the ring's pixels out of the cut-outs.

        Parameters
        ----------
        cutouts : Cutouts
            Pieces of all frames.
        places : (F,) int array
            Which of them.
        parameters : (F, 5) array
            Centre, radius and ellipse of each, px.

        Returns
        -------
        Ring
        """
        width = cutouts.gray.shape[1]
        origin = np.rint(parameters[:, :2]).astype(np.int64)
        first = origin - cutouts.corner[places]
        inside = np.all((first >= self._reach) & (first < width - self._reach), axis=1)
        first = np.where(inside[:, None], first, width // 2)
        offset = (self._y * width + self._x).ravel()
        start = (places * width + first[:, 1]) * width + first[:, 0]
        flat = start[:, None] + offset
        shape = (len(places), *self._x.shape)
        gray, background, inverse = (
            piece.take(flat).reshape(shape)
            for piece in (cutouts.gray, cutouts.background, cutouts.inverse_noise)
        )
        x, y = self._x.astype(np.float32), self._y.astype(np.float32)
        away = (parameters[:, :2] - origin).astype(np.float32)[:, :, None, None]
        radius = parameters[:, 2].astype(np.float32)[:, None, None]
        depth = np.sqrt((x - away[:, 0]) ** 2 + (y - away[:, 1]) ** 2) - radius
        counts = (depth > -self._inner) & (depth < self._outer) & (inverse > 0)
        inverse *= counts * self._real
        size = np.count_nonzero(inverse, axis=2)
        good = size >= _FEWEST_IN_SECTOR
        inverse *= good[:, :, None]
        most = good.shape[1]
        enough = inside & (size.sum(axis=1) >= _FEWEST_PIXELS)
        enough &= np.count_nonzero(good, axis=1) >= max(4, 0.4 * most)
        counted = np.where(good, size, 0).astype(np.float64)
        return Ring(x, y, origin.astype(np.float64), gray, background, inverse, counted, enough)


# Prior widths of the sector's k (about 1) in units of itself, and of A and C in units of full
# scale.
_SHADOW_PRIOR = 0.3

_SHADING_PRIOR = 255.0
"""Gray levels, prior width of the light of a sector: full scale, that is none."""

_SMALL_RADIUS = 10.0
"""px: smaller balls show less of their light within a sector, and its priors narrow with them."""

_OFFSET_SCALES = 2.0

_BASIS = 3
"""Unknowns of a sector's light: shadow factor, level and slope."""

# A sector that fits so much worse than most has something in it that the model does not know.
_PANELLED = 1.4

# Directions in which a sector's three numbers are told apart by less than this part of the rest
# are not told apart at all.
_RIDGE = 1e-8


class Equations:
    """What all frames share: the edge profile, and what is known of a sector's linear part.

    Parameters
    ----------
    profile : EdgeProfile
        Edge profiles.
    radius : float
        Typical radius, px: a small ball has too few pixels to free k, A and C.
    """

    def __init__(self, profile: EdgeProfile, radius: float) -> None:
        self.profile = profile
        small = min(1.0, radius / _SMALL_RADIUS)
        self.priors = np.array(
            [
                1.0 / (_SHADOW_PRIOR * small) ** 2,
                1.0 / _SHADING_PRIOR**2,
                1.0 / (_SHADING_PRIOR * small) ** 2,
            ]
        )


@dataclass(frozen=True)
class Sums:
    """What the solution needs of each sector's pixels.

    Attributes
    ----------
    information : (F, S, m, m) array
        Of centre x, y, radius and, for m = 5, ellipse, the linear part eliminated.
    score : (F, S, m) array
        What pulls at them.
    square : (F, S) array
        Sum of squared residuals over noise.
    size : (F, S) array
        Number of pixels.
    """

    information: FloatArray
    score: FloatArray
    square: FloatArray
    size: FloatArray


def _dots(left: list[FloatImage], right: list[FloatImage]) -> FloatArray:
    """Scalar products over the pixels, (F, S, len(left), len(right))."""
    rows = [[np.einsum("nsl,nsl->ns", one, other) for other in right] for one in left]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2).astype(np.float64)


def _square_dots(parts: list[FloatImage]) -> FloatArray:
    """The same for all pairs of one list, each computed once."""
    count = len(parts)
    shape = (*parts[0].shape[:2], count, count)
    result = np.empty(shape)
    for i in range(count):
        for j in range(i, count):
            result[..., i, j] = result[..., j, i] = np.einsum("nsl,nsl->ns", parts[i], parts[j])
    return result


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverses of many symmetric 3 × 3 matrices, by their adjugates."""
    a, b, c = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 0, 2]
    d, e, f = matrix[..., 1, 1], matrix[..., 1, 2], matrix[..., 2, 2]
    result = np.empty_like(matrix)
    result[..., 0, 0] = d * f - e * e
    result[..., 0, 1] = result[..., 1, 0] = c * e - b * f
    result[..., 0, 2] = result[..., 2, 0] = b * e - c * d
    result[..., 1, 1] = a * f - c * c
    result[..., 1, 2] = result[..., 2, 1] = b * c - a * e
    result[..., 2, 2] = a * d - b * b
    determinant = a * result[..., 0, 0] + b * result[..., 0, 1] + c * result[..., 0, 2]
    return result / determinant[..., None, None]


def linearised(
    equations: Equations, ring: Ring, parameters: FloatArray, smear: FloatArray, size: int
) -> Sums:
    """Solve each sector's linear part and sum up residuals and derivatives, all over the noise.

    Parameters
    ----------
    equations : Equations
        Profile and priors.
    ring : Ring
        The pixels.
    parameters : (F, 5) array
        Centre x, y, radius, ellipse a, b, px.
    smear : (F, 2) array
        Motion during the exposure, px.
    size : int
        Of how many parameters derivatives are wanted: 3 or 5.

    Returns
    -------
    Sums
    """
    polar = _polar(ring, parameters, smear, size)
    inverse = ring.inverse_noise
    cover, slope, shade, shade_slope = equations.profile(polar.depth, polar.smear)
    seen = ring.background * inverse
    inside = cover * inverse
    basis = [seen - cover * seen, inside, shade * inverse]
    target = ring.gray * inverse
    plain = _square_dots(basis)
    right = _dots(basis, [target])[..., 0]
    # The priors keep this regular even for a sector without pixels.
    gram = plain + np.diag(equations.priors) + 1e-9 * np.eye(_BASIS)
    wanted = right.copy()
    wanted[..., 0] += equations.priors[0]
    solution = np.einsum("nsij,nsj->nsi", _inverse(gram), wanted)
    k, a, c = (solution[..., i, None].astype(np.float32) for i in range(_BASIS))
    residual = target - k * basis[0] - a * basis[1] - c * basis[2]
    gradient = (a * inverse - k * seen) * slope + c * (shade_slope * inverse)
    jacobian = [-gradient * part for part in polar.derivatives]
    cross = _dots(basis, jacobian)
    ridge = _RIDGE * np.trace(plain, axis1=2, axis2=3)[..., None, None] + 1e-6
    left_over = right - np.einsum("nsij,nsj->nsi", plain, solution)
    carried = _inverse(plain + ridge * np.eye(_BASIS)) @ cross
    return Sums(
        _square_dots(jacobian) - cross.swapaxes(2, 3) @ carried,
        _dots(jacobian, [residual])[..., 0] - np.einsum("nsij,nsi->nsj", carried, left_over),
        np.einsum("nsl,nsl->ns", residual, residual).astype(np.float64),
        ring.size,
    )


@dataclass(frozen=True)
class _Polar:
    """Pixels as seen from the centres: distance from the outline, and how that changes."""

    depth: FloatImage
    smear: FloatImage | None
    derivatives: list[FloatImage]


def _polar(ring: Ring, parameters: FloatArray, smear: FloatArray, size: int) -> _Polar:
    away = (parameters[:, :2] - ring.origin).astype(np.float32)[:, :, None, None]
    shape = parameters[:, 2:].astype(np.float32)[:, :, None, None]
    dx, dy = ring.x - away[:, 0], ring.y - away[:, 1]
    rho = np.sqrt(dx * dx + dy * dy)
    ux, uy = dx / rho, dy / rho
    depth = rho - shape[:, 0]
    derivatives = [ux, uy, np.float32(1.0) + np.zeros_like(ux)]
    if size > 3 or np.any(parameters[:, 3:]):
        cos2, sin2 = ux * ux - uy * uy, 2 * ux * uy
        depth -= shape[:, 1] * cos2 + shape[:, 2] * sin2
        derivatives += [cos2, sin2]
    along = None
    if np.any(smear):
        move = smear.astype(np.float32)[:, :, None, None]
        along = np.abs(ux * move[:, 0] + uy * move[:, 1])
    return _Polar(depth, along, derivatives[:size])


def reduced(sums: Sums, settled: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal equations of the outlines: sectors that do not fit the model down-weighted.

    Parameters
    ----------
    sums : Sums
        Of each sector.
    settled : (F,) bool array
        Where the outline is near enough for sectors to be judged by their offset from it.

    Returns
    -------
    normal : (F, m, m) array
        Normal matrices.
    score : (F, S, m) array
        Each sector's weighted pull.
    information : (F, S, m, m) array
        Each sector's information by noise alone.
    """
    own = np.sqrt(sums.square / np.maximum(sums.size - _BASIS, 1.0))
    seen = sums.size > 0
    typical = np.maximum(_middle(own, seen), 0.5)[:, None]
    weight = np.where(seen, (2.0 / (1.0 + (own / typical) ** 2)) ** 2 / typical**2, 0.0)
    known = sums.information[..., 2, 2]
    # No sector tells the outline better than the sectors agree, however sharp its edge.
    robust, scale = _offset_weight(sums.score[..., 2], known, seen)
    shared = robust / (1.0 + scale[:, None] ** 2 * known * weight)
    weight = np.where(settled[:, None], weight * shared, weight)
    normal = np.einsum("ns,nsij->nij", weight, sums.information)
    return normal, weight[..., None] * sums.score, sums.information


def panelled(sums: Sums) -> BoolArray:
    """Sectors (F, S) that the model describes much worse than most: a panel's edge is in them."""
    own = np.sqrt(sums.square / np.maximum(sums.size - _BASIS, 1.0))
    seen = sums.size > 0
    typical = np.maximum(_middle(own, seen), 0.5)[:, None]
    return np.asarray(seen & (own > _PANELLED * typical))


def _middle(values: FloatArray, chosen: BoolArray) -> FloatArray:
    """Upper median along the rows, of the chosen ones only."""
    count = np.count_nonzero(chosen, axis=1)
    ordered = np.sort(np.where(chosen, values, np.inf), axis=1)
    place = np.minimum(count // 2, values.shape[1] - 1)
    middle = ordered[np.arange(len(values)), place]
    return np.where(count > 0, middle, 0.0)


def _offset_weight(
    pull: FloatArray, information: FloatArray, seen: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Weight of sectors by how far their own edge lies off the common outline, and the usual, px.

    A panel's edge just inside a white ball before a white wall is sharper than the outline itself;
    it is told by its offset.
    """
    offset = pull / np.maximum(information, 1e-9)
    size = np.abs(offset)
    outward = seen & (offset > 0)
    every = _middle(size, seen)
    clear = np.where(np.count_nonzero(outward, axis=1) > 3, _middle(size, outward), every)
    scale = np.maximum(1.4826 * np.minimum(every, clear), 0.03)[:, None]
    inward = (offset < 0).astype(np.float64)
    weight = 1.0 / (1.0 + (offset / (_OFFSET_SCALES * scale)) ** 2) ** (1.0 + inward)
    return np.asarray(weight), scale[:, 0]
