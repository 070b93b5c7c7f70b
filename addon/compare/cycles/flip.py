"""FLIP: the difference a person sees who flips between two pictures on a screen, 0 (none) to 1.

Built from the equations of the paper, for pictures of low dynamic range. Two pipelines: *color* blurs both pictures by
what the eye resolves at this viewing distance and takes a perceptual color distance; *features* compares edges and
points, which a person notices at once, and amplifies the color difference by them.

References
----------
Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild, "FLIP: A Difference Evaluator for Alternating Images",
Proceedings of the ACM on Computer Graphics and Interactive Techniques 3(2), 2020.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

# A 0.7 m wide screen of 3840 pixels seen from 0.7 m, the default of the authors' tool: 67 pixels per degree.
PIXELS_PER_DEGREE = 0.7 * 3840 / 0.7 * np.pi / 180

# Linear sRGB to XYZ (IEC 61966-2-1); white is the image of (1, 1, 1).
XYZ_FROM_RGB = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
WHITE = XYZ_FROM_RGB.sum(axis=1)

# Contrast sensitivity of the eye per channel of YCxCz: sums of Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b) (table 1).
SENSITIVITY = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
WIDEST = max(b for channel in SENSITIVITY for _, b in channel)

COLOR_EXPONENT = 0.7  # q_c, compresses large color differences
COLOR_KNEE = 0.4  # p_c, color differences up to this share of the largest ...
COLOR_KNEE_VALUE = 0.95  # p_t, ... map to errors up to this
FEATURE_WIDTH = 0.082  # w, degrees: width of the edges and points looked for
FEATURE_EXPONENT = 0.5  # q_f


def flip(image: Floats, reference: Floats, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Floats:
    """Return the FLIP error of each pixel, Delta E = Delta E_c ^ (1 - Delta E_f).

    Parameters
    ----------
    image, reference : (h, w, 3) float, *linear* sRGB primaries; clipped to 0 ... 1, what a screen can show
    pixels_per_degree : pixels that one degree of the viewer's field of view covers

    Returns
    -------
    (h, w) float64, 0 ... 1
    """
    one, other = (to_opponent(np.clip(np.asarray(picture, np.float64), 0, 1)) for picture in (image, reference))
    color = compare_colors(*(filter_by_sensitivity(opponent, pixels_per_degree) for opponent in (one, other)))
    features = compare_features((one[..., 0] + 16) / 116, (other[..., 0] + 16) / 116, pixels_per_degree)
    return color ** (1 - features)


def mean_flip(image: Floats, reference: Floats, pixels_per_degree: float = PIXELS_PER_DEGREE) -> float:
    """Return the mean FLIP error of two linear pictures (h, w, 3)."""
    return float(flip(image, reference, pixels_per_degree).mean())


def to_opponent(rgb: Floats) -> Floats:
    """Return YCxCz of linear RGB: luminance, red-green and blue-yellow, linear in XYZ."""
    x, y, z = np.moveaxis(rgb @ XYZ_FROM_RGB.T / WHITE, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def from_opponent(opponent: Floats) -> Floats:
    """Return linear RGB of YCxCz."""
    y = (opponent[..., 0] + 16) / 116
    xyz = np.stack([y + opponent[..., 1] / 500, y, y - opponent[..., 2] / 200], axis=-1) * WHITE
    return xyz @ np.linalg.inv(XYZ_FROM_RGB).T


def to_lab(rgb: Floats) -> Floats:
    """Return CIE L*a*b* of linear RGB."""
    relative = rgb @ XYZ_FROM_RGB.T / WHITE
    knee = 6 / 29
    root = np.where(relative > knee**3, np.cbrt(relative), relative / (3 * knee**2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def convolve_separable(channel: Floats, vertical: Floats, horizontal: Floats) -> Floats:
    """Return an (h, w) channel convolved with the kernel vertical^T horizontal; the border pixels go on outside."""
    radius = len(vertical) // 2
    height, width = channel.shape
    padded = np.pad(channel, radius, mode="edge")
    rows = sum(weight * padded[i : i + height] for i, weight in enumerate(vertical[::-1]))
    return np.asarray(sum(weight * rows[:, i : i + width] for i, weight in enumerate(horizontal[::-1])))


def filter_by_sensitivity(opponent: Floats, pixels_per_degree: float) -> Floats:
    """Return linear RGB of a YCxCz picture blurred by the eye's contrast sensitivity (section 4.1.1)."""
    radius = int(np.ceil(3 * np.sqrt(WIDEST / (2 * np.pi**2)) * pixels_per_degree))
    degrees = np.arange(-radius, radius + 1) / pixels_per_degree
    blurred = []
    for channel, gaussians in zip(np.moveaxis(opponent, -1, 0), SENSITIVITY, strict=True):
        profiles = [(a * np.sqrt(np.pi / b), np.exp(-(np.pi**2) * degrees**2 / b)) for a, b in gaussians]
        total = sum(height * profile.sum() ** 2 for height, profile in profiles)
        parts = [height / total * convolve_separable(channel, profile, profile) for height, profile in profiles]
        blurred.append(sum(parts))
    return np.clip(from_opponent(np.stack(blurred, axis=-1)), 0, 1)


def measure_color_distance(rgb: Floats, other: Floats) -> Floats:
    """Return the HyAB distance of two linear RGB pictures in Hunt-adjusted L*a*b*, raised to q_c (section 4.1.2).

    HyAB = |L - L'| + sqrt((a - a')^2 + (b - b')^2); Hunt's effect: dark colors look less colorful, a_h = 0.01 L a.
    """
    adjusted = []
    for lab in (to_lab(rgb), to_lab(other)):
        lightness = lab[..., :1]
        adjusted.append(np.concatenate([lightness, 0.01 * lightness * lab[..., 1:]], axis=-1))
    difference = adjusted[0] - adjusted[1]
    distance = np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2])
    return distance**COLOR_EXPONENT


def compare_colors(rgb: Floats, other: Floats) -> Floats:
    """Return the color error Delta E_c of blurred pictures, 0 ... 1; the largest distance is green to blue."""
    largest = measure_color_distance(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    distance = measure_color_distance(rgb, other)
    knee = COLOR_KNEE * largest
    above = COLOR_KNEE_VALUE + (distance - knee) / (largest - knee) * (1 - COLOR_KNEE_VALUE)
    return np.clip(np.where(distance < knee, COLOR_KNEE_VALUE / knee * distance, above), 0, 1)


def compare_features(luminance: Floats, other: Floats, pixels_per_degree: float) -> Floats:
    """Return the feature error Delta E_f, (h, w): the larger difference of edges and of points (section 4.2)."""
    edges = [detect_features(picture, 1, pixels_per_degree) for picture in (luminance, other)]
    points = [detect_features(picture, 2, pixels_per_degree) for picture in (luminance, other)]
    difference = np.maximum(np.abs(edges[0] - edges[1]), np.abs(points[0] - points[1]))
    return np.clip((difference / np.sqrt(2)) ** FEATURE_EXPONENT, 0, 1)


def detect_features(luminance: Floats, order: int, pixels_per_degree: float) -> Floats:
    """Return the size of the gradient (order 1: edges) or of the second derivatives (order 2: points), (h, w).

    The kernels are derivatives of a Gaussian, scaled so that their positive weights sum to 1 and the negative to -1.
    """
    deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree
    radius = int(np.ceil(3 * deviation))
    offset = np.arange(-radius, radius + 1)
    gaussian = np.exp(-(offset**2) / (2 * deviation**2))
    derivative = -offset * gaussian if order == 1 else ((offset / deviation) ** 2 - 1) * gaussian
    derivative = np.where(
        derivative > 0, derivative / derivative[derivative > 0].sum(), -derivative / derivative[derivative < 0].sum()
    )
    smooth = gaussian / gaussian.sum()
    return np.hypot(
        convolve_separable(luminance, smooth, derivative), convolve_separable(luminance, derivative, smooth)
    )
