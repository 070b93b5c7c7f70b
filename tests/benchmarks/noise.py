"""How noisy independent renders of one picture are, also without the noisiest pixels, and times at equal noise.

Noise is the root mean square of the renders' differences from their mean, over the mean level of the picture. A few
fireflies can hold most of it, and then little can be told of what more samples would bring; so it is also measured
without the noisiest pixels. Times to an error are read off between renders that were made, never beyond them.
"""

from __future__ import annotations

import numpy as np

# Half of the renders tell which pixels are noisy, the others by how much; and one more is left out in turn.
FEWEST_RENDERS = 5
# Shares of the pixels that are left out, the noisiest ones.
SHARES = {"all": 0.0, "without 1%": 0.01, "without 5%": 0.05}


def measure_noise(pictures):
    """Return the root mean square noise of independent pictures (k, h, w, 3), over their mean level."""
    pictures = np.asarray(pictures, dtype=np.float64)
    return float(np.sqrt(pictures.var(axis=0, ddof=1).mean()) / pictures.mean())


def measure_noise_without(pictures, share):
    """Return the noise of 4 or more pictures (k, h, w, 3) in the pixels that are left without the noisiest `share`.

    Which pixels are noisy is told by one half of the renders and how noisy the others are by the other half, and the
    other way round. Told by the same renders, also of even noise the pixels that happened to vary most would go.
    """
    pictures = np.asarray(pictures, dtype=np.float64)
    if share == 0:
        return measure_noise(pictures)
    spreads = [half.var(axis=0, ddof=1).mean(axis=-1).ravel() for half in (pictures[::2], pictures[1::2])]
    count = spreads[0].size - round(share * spreads[0].size)
    left = [spreads[1 - k][np.argsort(spreads[k], kind="stable")[:count]].mean() for k in range(2)]
    return float(np.sqrt(np.mean(left)) / pictures.mean())


def measure_errors(pictures):
    """Return name of SHARES -> noise, of pictures (k, h, w, 3)."""
    return {name: measure_noise_without(pictures, share) for name, share in SHARES.items()}


def leave_one_out(pictures):
    """Return name of SHARES -> (k,) noise of all renders but one, for the jackknife."""
    left = [measure_errors(np.delete(pictures, k, axis=0)) for k in range(len(pictures))]
    return {name: [errors[name] for errors in left] for name in SHARES}


def read_seconds(errors, seconds, target):
    """Return the seconds to an error, between renders of more and more samples; None where it is not among them.

    Between two renders the error is a power of the time: a straight line of the logarithms.
    """
    if target == errors[0]:
        return seconds[0]
    for k in range(1, len(errors)):
        if errors[k] <= target < errors[k - 1]:
            if errors[k] == 0:
                return seconds[k]
            part = np.log(errors[k - 1] / target) / np.log(errors[k - 1] / errors[k])
            return float(seconds[k - 1] * (seconds[k] / seconds[k - 1]) ** part)
    return None


def compare_seconds(ours, other):
    """Return (error, seconds of `other` over those of `ours`) at the smallest error that both have reached.

    ours, other : (errors, seconds) of renders of more and more samples. None where their errors have none in common, or
    there is no noise.
    """
    target = max(min(ours[0]), min(other[0]))
    if target == 0:
        return None
    mine, theirs = (read_seconds(*curve, target) for curve in (ours, other))
    return None if mine is None or theirs is None else (target, theirs / mine)


def jackknife(values):
    """Return the standard error of a statistic from its values without one of k each.

    sqrt((k - 1) / k sum (v_i - mean)^2), B. Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", 1982.
    """
    values = np.asarray(values, dtype=np.float64)
    return float(np.sqrt((len(values) - 1) * np.mean((values - values.mean()) ** 2)))
