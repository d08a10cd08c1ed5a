"""Sub-pixel outline of a ball: an edge model fitted to the pixels against the known background.

In a ring of pixels about the outline, each a mixture of background and ball,

    I = k·(1 − G₀(ρ))·B + A·G₀(ρ) + C·G₁(ρ),

B is the known background (so that grid lines behind the ball pull nothing), G₀ the covered part of
the
pixel and G₁ the same times the sphere's shading (`vision.edge_profile`). k (a shadow behind the
ball), A
and C (whatever colour and shading the ball has there) are free in each sector of the outline, so
that
neither panels nor light bias it; they are eliminated (variable projection, Golub and Pereyra 1973)
and
only the outline's few parameters are iterated. Sectors that the model does not describe lose
weight.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.edge_profile import EdgeProfile

__all__ = ["OutlineFit", "OutlineShape", "RingPixels", "fit_outline"]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Prior widths of the sector's k (about 1) in units of itself, and of A and C in units of full
# scale.
_SHADOW_PRIOR = 0.3
_SHADING_PRIOR = 255.0
_SMALL_RADIUS = 10.0
_OFFSET_SCALES = 2.0
_BASIS = 3


@dataclass(frozen=True)
class OutlineShape:
    """Outline in polar form about its centre: r + a cos 2θ + b sin 2θ.

    Attributes
    ----------
    radius : float
        Mean radius, px.
    ellipse : (2,) array
        a and b, px: half the difference of the semi-axes, by direction.
    """

    radius: float
    ellipse: FloatArray


@dataclass(frozen=True)
class RingPixels:
    """The pixels that a fit looks at.

    Attributes
    ----------
    x, y : (n,) arrays
        Positions, px.
    gray : (n,) array
        Gray levels.
    background : (n,) array
        Background there, in this frame's brightness.
    noise : (n,) array
        Standard deviation of each, gray levels.
    usable : (n,) bool array
        False where something else is in front.
    """

    x: FloatArray
    y: FloatArray
    gray: FloatArray
    background: FloatArray
    noise: FloatArray
    usable: BoolArray


@dataclass(frozen=True)
class OutlineFit:
    """Result of one fit.

    Attributes
    ----------
    centre : (2,) array
        Centre, px.
    shape : OutlineShape
        Outline about it.
    covariance : (m, m) array
        Of x, y and, where fitted, radius and ellipse, px²; from the scatter that each sector shows.
    bound : (m, m) array
        Cramér–Rao bound of the same parameters from noise and contrast alone, px².
    misfit : float
        Root mean square residual over noise.
    contrast : float
        Part of the sectors whose edge stands out from the noise, 0 to 1.
    converged : bool
        Whether the last step was small.
    normal : (5, 5) array
        Normal matrix of all five parameters (x, y, radius, ellipse) at the solution, 1/px².
    pull : (5,) array
        What each of them is still pulled by there, 1/px.
    """

    centre: FloatArray
    shape: OutlineShape
    covariance: FloatArray
    bound: FloatArray
    misfit: float
    contrast: float
    converged: bool
    normal: FloatArray
    pull: FloatArray


@dataclass(frozen=True)
class _Ring:
    """Pixels sorted into sectors, padded to equal length."""

    index: NDArray[np.int64]
    weight: FloatArray


@dataclass(frozen=True)
class _Linearised:
    basis: FloatArray
    jacobian: FloatArray
    residual: FloatArray


def fit_outline(
    pixels: RingPixels,
    profile: EdgeProfile,
    centre: FloatArray,
    shape: OutlineShape,
    *,
    smear: FloatArray,
    free: int = 2,
    radius_std: float = np.inf,
    inner: float = 6.0,
    outer: float = 4.0,
    iterations: int = 8,
    tolerance: float = 4e-3,
) -> OutlineFit | None:
    """Fit a ball's outline.

    Parameters
    ----------
    pixels : RingPixels
        Pixels around; those outside the ring are left out.
    profile : EdgeProfile
        Edge profiles for about this radius.
    centre : (2,) array
        Starting centre, px.
    shape : OutlineShape
        Starting (or fixed) shape.
    smear : (2,) array
        Motion during the exposure, px.
    free : int
        2: centre only; 3: and radius; 5: and ellipse.
    radius_std : float
        How far from the starting radius a free one may be, one sigma, px.
    inner, outer : float
        How far the ring reaches inside and outside the outline, px.
    iterations : int
        Steps at most.
    tolerance : float
        A step shorter than this is the last, px.

    Returns
    -------
    OutlineFit or None
        None where too little of the outline is in view.
    """
    parameters = np.array([*centre, shape.radius, *shape.ellipse], dtype=np.float64)
    held = np.zeros(free)
    if free > 2:
        held[2] = 1.0 / radius_std**2
    priors = _priors(shape.radius)
    ring = _ring(pixels, parameters, inner, outer)
    if ring is None:
        return None
    converged = False
    last = 1e9
    for _ in range(iterations):
        state = _linearise(pixels, ring, profile, parameters, smear, priors)
        normal, gradient, _ = _reduced(state, ring, free, last < 0.3)
        pull = gradient.sum(axis=0)
        if free > 2:
            pull[2] -= held[2] * (parameters[2] - shape.radius)
        damped = normal + 1e-6 * np.trace(normal) * np.eye(free) + np.diag(held)
        step = np.linalg.solve(damped, pull)
        limit = 0.35 * inner
        length = float(np.hypot(step[0], step[1]))
        step *= min(1.0, limit / max(length, 1e-12))
        parameters[:free] += step
        if length < tolerance:
            converged = True
            break
        if length > 0.3:
            fresh = _ring(pixels, parameters, inner, outer)
            if fresh is None:
                return None
            ring = fresh
        last = length
    state = _linearise(pixels, ring, profile, parameters, smear, priors)
    return _summary(state, ring, parameters, free, converged or last < 0.05, held)


def _priors(radius: float) -> FloatArray:
    """Prior information on a sector's k, A and C: a small ball has too few pixels to free them."""
    small = min(1.0, radius / _SMALL_RADIUS)
    return np.array(
        [
            1.0 / (_SHADOW_PRIOR * small) ** 2,
            1.0 / _SHADING_PRIOR**2,
            1.0 / (_SHADING_PRIOR * small**2) ** 2,
        ]
    )


def _ring(pixels: RingPixels, parameters: FloatArray, inner: float, outer: float) -> _Ring | None:
    """Choose the ring's pixels and sort them into sectors of about four pixels of outline."""
    dx, dy = pixels.x - parameters[0], pixels.y - parameters[1]
    rho = np.hypot(dx, dy)
    depth = rho - parameters[2]
    chosen = np.nonzero((depth > -inner) & (depth < outer) & pixels.usable)[0]
    if len(chosen) < 24:
        return None
    count = int(np.clip(round(2 * np.pi * parameters[2] / 4.0), 6, 40))
    angle = np.arctan2(dy[chosen], dx[chosen])
    sector = np.floor((angle / (2 * np.pi) + 0.5) * count).astype(np.int64) % count
    order = np.argsort(sector, kind="stable")
    chosen, sector = chosen[order], sector[order]
    sizes = np.bincount(sector, minlength=count)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    longest = int(sizes.max())
    place = np.arange(len(chosen)) - starts[sector]
    index = np.zeros((count, longest), dtype=np.int64)
    weight = np.zeros((count, longest))
    index[sector, place] = chosen
    weight[sector, place] = 1.0
    weight[sizes < 5] = 0.0
    if np.count_nonzero(sizes >= 5) < max(4, 0.4 * count):
        return None
    return _Ring(index, weight)


def _linearise(
    pixels: RingPixels,
    ring: _Ring,
    profile: EdgeProfile,
    parameters: FloatArray,
    smear: FloatArray,
    prior: FloatArray,
) -> _Linearised:
    """Solve each sector's linear part, and give residual and derivatives, all over the noise."""
    index = ring.index
    dx, dy = pixels.x[index] - parameters[0], pixels.y[index] - parameters[1]
    rho = np.maximum(np.hypot(dx, dy), 1e-6)
    ux, uy = dx / rho, dy / rho
    cos2, sin2 = ux * ux - uy * uy, 2 * ux * uy
    depth = rho - (parameters[2] + parameters[3] * cos2 + parameters[4] * sin2)
    along = np.abs(ux * smear[0] + uy * smear[1])
    cover, slope, shade, shade_slope = profile(depth.ravel(), along.ravel()).reshape(
        4, *depth.shape
    )
    inverse = ring.weight / pixels.noise[index]
    background = pixels.background[index]
    basis = np.stack([(1 - cover) * background * inverse, cover * inverse, shade * inverse], axis=2)
    target = pixels.gray[index] * inverse
    transposed = basis.transpose(0, 2, 1)
    gram = transposed @ basis + np.diag(prior) + 1e-9 * np.eye(_BASIS)
    right = transposed @ target[:, :, None]
    right[:, 0] += prior[0]
    solution = np.linalg.solve(gram, right)
    residual = target - (basis @ solution)[:, :, 0]
    solution = solution[:, :, 0]
    k, a, c = (solution[:, i, None] for i in range(_BASIS))
    gradient = ((a - k * background) * slope + c * shade_slope) * inverse
    jacobian = np.stack(
        [-gradient * ux, -gradient * uy, -gradient, -gradient * cos2, -gradient * sin2], axis=2
    )
    return _Linearised(basis, jacobian, residual)


def _reduced(
    state: _Linearised, ring: _Ring, free: int, settled: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal equations of the outline alone: linear parts projected out, misfits down-weighted.

    Returns the normal matrix, each sector's weighted pull, and each sector's information by noise
    alone.
    """
    basis, jacobian, residual = state.basis, state.jacobian[:, :, : max(free, 3)], state.residual
    transposed = basis.transpose(0, 2, 1)
    gram = transposed @ basis + 1e-6 * np.eye(_BASIS)
    projected = jacobian - basis @ np.linalg.solve(gram, transposed @ jacobian)
    turned = projected.transpose(0, 2, 1)
    information = turned @ projected
    score = (turned @ residual[:, :, None])[:, :, 0]
    sizes = ring.weight.sum(axis=1)
    own = np.sqrt(np.sum(residual**2, axis=1) / np.maximum(sizes - _BASIS, 1.0))
    seen = sizes > 0
    typical = max(_middle(own[seen]), 0.5)
    weight = np.where(seen, (2.0 / (1.0 + (own / typical) ** 2)) ** 2 / typical**2, 0.0)
    if settled:
        weight = weight * _offset_weight(score[:, 2], information[:, 2, 2], seen)
    normal = np.tensordot(weight, information[:, :free, :free], axes=1)
    return normal, weight[:, None] * score[:, :free], information[:, :free, :free]


def _middle(values: FloatArray) -> float:
    """Upper median of a few values, without the ceremony that makes `numpy.median` slow on them."""
    return float(np.sort(values)[len(values) // 2])


def _offset_weight(pull: FloatArray, information: FloatArray, seen: BoolArray) -> FloatArray:
    """Weight of sectors by how far their own edge lies off the common outline.

    A panel's edge just inside a white ball before a white wall is sharper than the outline itself;
    it is told by its offset.
    """
    offset = pull / np.maximum(information, 1e-9)
    outward = offset[seen & (offset > 0)]
    every = _middle(np.abs(offset[seen]))
    scale = max(1.4826 * min(every, _middle(outward) if len(outward) > 3 else every), 0.03)
    inward = (offset < 0).astype(np.float64)
    return np.asarray(1.0 / (1.0 + (offset / (_OFFSET_SCALES * scale)) ** 2) ** (1.0 + inward))


def _summary(
    state: _Linearised,
    ring: _Ring,
    parameters: FloatArray,
    free: int,
    converged: bool,
    held: FloatArray,
) -> OutlineFit:
    whole, pulls, every = _reduced(state, ring, 5, True)
    normal, score, information = whole[:free, :free], pulls[:, :free], every[:, :free, :free]
    inverse = np.linalg.inv(normal + np.diag(held) + 1e-9 * np.trace(normal) * np.eye(free))
    seen = ring.weight.sum(axis=1) > 0
    count = int(np.count_nonzero(seen))
    meat = score.T @ score * count / max(count - free, 1)
    covariance = inverse @ meat @ inverse
    total = information.sum(axis=0)
    bound = np.linalg.inv(total + np.diag(held) + 1e-9 * np.trace(total) * np.eye(free))
    sizes = ring.weight.sum()
    misfit = float(np.sqrt(np.sum(state.residual**2) / max(sizes - _BASIS * count, 1.0)))
    strength = information[:, 0, 0] + information[:, 1, 1]
    contrast = float(np.count_nonzero(strength > 4.0 * misfit**2) / len(seen))
    return OutlineFit(
        parameters[:2].copy(),
        OutlineShape(float(parameters[2]), parameters[3:5].copy()),
        covariance,
        bound,
        misfit,
        contrast,
        converged,
        whole,
        pulls.sum(axis=0),
    )
