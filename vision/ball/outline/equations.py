"""The outline's normal equations: each sector's linear part solved and projected out.

All sums run over the pixels of one sector of one frame; the arrays carry (frame, sector, pixel).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ball.outline.edge_profile import EdgeProfile
from vision.ball.outline.ring import Ring

__all__ = ["Equations", "Sums", "linearised", "panelled", "reduced"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

# Prior widths of the sector's k (about 1) in units of itself, and of A and C in units of full
# scale.
_SHADOW_PRIOR = 0.3
_SHADING_PRIOR = 255.0
_SMALL_RADIUS = 10.0
_OFFSET_SCALES = 2.0
_BASIS = 3
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
