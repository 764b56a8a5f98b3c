"""The best linear model of every recorded rig: a reference that is not softrig's.

For each rig this fits, by output error (simulation from a free initial state,
every sample of every recording weighted equally), the linear model

    second order    a'' = -c a' - k a + g p + d        c >= 0, k >= 0
    first order     tau a' + a = g p + d               up to the integrator a' = g p + d

with angle a (degrees), pressure p (kPa) and a constant offset d. It answers one
question: can a linear model follow this rig better than `softrig init` or `softrig fit` did?
It is independent of softrig: another language, no code in common, no first guess (the
numbers of model.toml are not used), exact discretisation instead of integration, and a
search over all time scales and damping ratios instead of a descent from one model. For
given c and k the output is linear in g, d and the initial states; these are solved by
least squares, so that only c and k are searched (variable projection).

How the figures are defined
  - The pressure is linear between samples, and across a gap; rows with a missing
    number are left out. No recording is thinned, smoothed or cut. Holdout
    recordings are not used.
  - One offset d per rig; `second_order_offset_each` has one per recording instead.
    Where all pressures are equal, offset and gain cannot be separated: no offset
    is fitted then.
  - If model.toml does not free the gain (free swings without input), there is no g.
    If it does not free the stiffness, k stays at the value there. Damping is always
    free.
  - The search: a grid over time scales (a third of the sampling interval to ten
    times the longest recording) and damping ratios (0.001 to 300), and the peaks of
    the angle's spectrum. The best twenty are refined by least squares, the best of
    these by Nelder-Mead; k = 0, c = 0 and the first-order limit are tried as well.
    Both signs of the gain are allowed throughout.
"""

import argparse
import csv
import json
import math
import os
import pathlib
import sys
import tempfile
import time
import tomllib

# Before numpy starts its threads: one core is enough, and results do not depend on more.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_variable] = "1"

import numpy as np  # noqa: E402
from scipy.integrate import solve_ivp  # noqa: E402
from scipy.linalg import expm  # noqa: E402
from scipy.optimize import least_squares, minimize  # noqa: E402
from scipy.signal import lsim  # noqa: E402

EXAMPLES = """examples:
  linear_output_error.py                            all rigs in ../shared/data, as a table
  linear_output_error.py -o tests/data/linear_output_error.json
                                                    the same, and written (several minutes)
  linear_output_error.py --rig rigs/rlc_step --rig real/silicone_beam
  linear_output_error.py --data DIR                 other rigs: DIR/{rigs,real}/NAME/
  linear_output_error.py --simulate DIR             write the simulated recordings to DIR
  linear_output_error.py --check                    exact steps against SciPy's expm and solve_ivp
"""
ABOUT = (
    "Smallest RMS output error (deg, over all samples of all recordings/*.csv) of linear models, "
    "by tests/tools/linear_output_error.py, which says how: second order a'' = -c a' - k a + g p + d "
    "(c_per_s, k_per_s2, gain_deg_per_s2_kpa, offset_deg_per_s2), first order tau a' + a = g p + d "
    "(tau_s, gain_deg_per_kpa, offset_deg; without tau_s the integrator a' = g p + d). Initial states "
    "are free per recording. null: not part of the fit. Where the fast pole is far beyond the sampling "
    "rate, only the ratios of c, k, gain and offset count: the rig is of first order. about_mean_deg "
    "is about one mean of all samples, about_own_means_deg about that of each recording. Under "
    "`simulated`: recordings that --simulate writes, with the truth they were made from."
)

STARTS = 20
SCALES_PER_DECADE = 8
DAMPING_RATIOS = np.array([0.001, 0.004, 0.015, 0.05, 0.15, 0.4, 0.8, 1.2, 2.5, 6, 15, 50, 300])
# A column that others explain up to this fraction is taken as explained by them.
DEPENDENT = 1e-9


# ---------------------------------------------------------------- recordings


class Rig:
    """All recordings of one rig, one after another in the same arrays."""

    def __init__(self, folder):
        with open(folder / "model.toml", "rb") as file:
            model = tomllib.load(file)
        free, dynamics = model["fit"]["free"], model["dynamics"]
        tables = [read_csv(path) for path in sorted((folder / "recordings").glob("*.csv"))]
        if not tables:
            raise SystemExit(f"{folder}: no recordings/*.csv")
        lengths = [len(table) for table in tables]
        self.count = len(tables)
        self.starts = np.cumsum([0] + lengths[:-1])
        self.recording = np.repeat(np.arange(self.count), lengths)
        self.time = np.concatenate([table[:, 0] - table[0, 0] for table in tables])
        self.pressure, self.angle = np.concatenate(tables)[:, 1:].T
        step = np.diff(self.time, prepend=0.0)
        step[self.starts] = 0.0
        self.longest = self.time.max()
        self.interval = np.median(step[step > 0])
        # Equal steps are computed once. Clock times differ by rounding: 1e-9 of a step.
        rounded = np.round(step / self.interval, 9) * self.interval
        self.steps, self.which_step = np.unique(rounded, return_inverse=True)
        self.has_gain = "input_gain" in free
        if not self.has_gain and np.any(self.pressure != 0):
            raise SystemExit(f"{folder}: a pressure acts, and its gain is not free: not supported")
        held = dynamics["stiffness_n_per_rad_n"] / dynamics["inertia_kg_m"]
        self.held_stiffness = None if "stiffness" in free else held
        self.has_offset = not (self.has_gain and np.ptp(self.pressure) == 0)

    def sums(self, values):
        """Sum of each recording, repeated for each of its samples."""
        return np.add.reduceat(values, self.starts)[self.recording]

    def about_mean(self):
        return rms(self.angle - self.angle.mean())

    def about_own_means(self):
        ones = np.ones_like(self.angle)
        return rms(self.angle - self.sums(self.angle) / self.sums(ones))


def read_csv(path):
    """Columns time_s, pressure_kpa and angle_deg; rows with a missing number are left out."""
    with open(path, newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        names = ("time_s", "pressure_kpa", "angle_deg")
        table = np.array([[float(row[name] or "nan") for name in names] for row in rows])
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 3 or np.any(np.diff(table[:, 0]) <= 0):
        raise SystemExit(f"{path}: fewer than three rows, or times that do not increase")
    return table


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


# ---------------------------------------------------------------- simulation


def phi(z):
    """(e^z - 1)/z and (e^z - 1 - z)/z^2: a constant and a ramp seen by a mode."""
    small = np.abs(z) < 0.3
    safe = np.where(small, 1.0, z)
    first = np.expm1(safe) / safe
    second = (first - 1) / safe
    if small.any():
        near = z[small]
        # Taylor series by Horner, to the last bit for |z| < 0.3.
        series = np.zeros_like(near)
        for n in range(13, 1, -1):
            series = series * near + 1 / math.factorial(n)
        second[small] = series
        first[small] = 1 + near * series
    return first, second


def recurrence(factor, added):
    """y[i] = factor[i] y[i-1] + added[i], from 0, in blocks so that numpy does the work."""
    width = math.isqrt(len(added)) + 1
    padding = (0, width * width - len(added))
    total = np.pad(added, padding).reshape(width, width).T.copy()
    product = np.pad(factor, padding).reshape(width, width).T.copy()
    for j in range(1, width):
        total[j] += product[j] * total[j - 1]
        product[j] *= product[j - 1]
    carried, before = 0.0, []
    for last_total, last_product in zip(total[-1].tolist(), product[-1].tolist()):
        before.append(carried)
        carried = last_total + last_product * carried
    total += product * np.array(before)
    return total.T.reshape(-1)[: len(added)]


def mode(rig, pole):
    """y' = pole y + input: from y = 1 without input, under input 1, under the pressure."""
    free = np.exp(pole * rig.time)
    constant = rig.time * phi(pole * rig.time)[0]
    if not rig.has_gain:
        return free, constant, None
    z = pole * rig.steps
    held, ramp = phi(z)
    before = np.concatenate(([0.0], rig.pressure[:-1]))
    at = rig.which_step
    added = (rig.steps * held)[at] * before + (rig.steps * ramp)[at] * (rig.pressure - before)
    factor = np.exp(z)[at]
    factor[rig.starts] = 0.0
    return free, constant, recurrence(factor, added)


def poles(c, k):
    """The two poles; equal ones are moved apart by 1e-5, which alters c and k by 1e-10."""
    root = np.sqrt(complex(c * c / 4 - k))
    if root.imag == 0:
        # The slow one from the product: the difference would lose all its digits.
        fast = -(c / 2 + root.real)
        slow = -k / -fast if fast else 0.0
    else:
        fast, slow = -c / 2 - root, -c / 2 + root
    if c == 0 and k == 0:
        raise ValueError("the double integrator has no modes; take a tiny stiffness")
    scale = max(abs(fast), abs(slow))
    if abs(fast - slow) < 1e-5 * scale:
        slow, fast = -c / 2 * (1 - 5e-6), -c / 2 * (1 + 5e-6)
    return slow, fast


def second_order(rig, c, k):
    """Responses to the initial angle and rate (one each), to the offset, to the pressure."""
    slow, fast = poles(c, k)
    if isinstance(slow, complex):
        # The other mode is the conjugate.
        free, constant, driven = mode(rig, slow)
        apart = slow.imag
        angle = free.real - slow.real / apart * free.imag
        by_offset = constant.imag / apart
        by_pressure = None if driven is None else driven.imag / apart
        return [angle, free.imag / apart], by_offset, by_pressure
    (free, constant, driven), (free2, constant2, driven2) = mode(rig, slow), mode(rig, fast)
    apart = slow - fast
    initial = [(slow * free2 - fast * free) / apart, (free - free2) / apart]
    by_pressure = None if driven is None else (driven - driven2) / apart
    return initial, (constant - constant2) / apart, by_pressure


def first_order(rig, rate):
    """The same for a' = -rate a + input, which has one initial state."""
    free, constant, driven = mode(rig, -rate)
    return [free], constant, driven


# ---------------------------------------------------------------- linear part


def residual(rig, responses, offset_each=False):
    """What remains of the angle after the best gain, offset and initial states."""
    initial, by_offset, by_pressure = responses
    per_recording, shared = list(initial), []
    if offset_each:
        per_recording.append(by_offset)
    elif rig.has_offset:
        shared.append(by_offset)
    if by_pressure is not None:
        shared.append(by_pressure)
    left = [rig.angle] + shared
    # Gram-Schmidt in each recording; twice, as once loses orthogonality.
    basis = []
    for column in per_recording:
        vector = unit(rig, column, basis)
        left = [one - vector * rig.sums(vector * one) for one in left]
        left = [one - vector * rig.sums(vector * one) for one in left]
        basis.append(vector)
    angle, used = left[0], []
    for column, original in zip(left[1:], shared):
        for _ in range(2):
            for vector in used:
                column = column - vector * (vector @ column)
        size = np.linalg.norm(column)
        if size > DEPENDENT * np.linalg.norm(original):
            used.append(column / size)
    for _ in range(2):
        for vector in used:
            angle = angle - vector * (vector @ angle)
    return angle


def unit(rig, column, basis):
    """`column` orthogonal to `basis` and of length 1, in each recording; 0 where dependent."""
    size = np.sqrt(rig.sums(column * column))
    vector = np.divide(column, size, out=np.zeros_like(column), where=size > 0)
    for _ in range(2):
        for other in basis:
            vector = vector - other * rig.sums(other * vector)
    size = np.sqrt(rig.sums(vector * vector))
    return np.divide(vector, size, out=np.zeros_like(column), where=size > DEPENDENT)


def coefficients(rig, responses):
    """Gain, offset and initial states (recordings by states), by one dense least squares.

    Returns also the simulated angle: the check that `residual` is right."""
    initial, by_offset, by_pressure = responses
    masks = [rig.recording == r for r in range(rig.count)]
    columns = [mask * column for mask in masks for column in initial]
    columns += [by_offset] if rig.has_offset else []
    columns += [by_pressure] if by_pressure is not None else []
    table = np.column_stack(columns)
    size = np.linalg.norm(table, axis=0)
    size[size == 0] = 1.0
    solution = np.linalg.lstsq(table / size, rig.angle, rcond=1e-12)[0] / size
    rest = list(solution[rig.count * len(initial):])
    offset = rest.pop(0) if rig.has_offset else None
    gain = rest.pop(0) if by_pressure is not None else None
    states = solution[: rig.count * len(initial)].reshape(rig.count, len(initial))
    return gain, offset, states, table @ solution


# ---------------------------------------------------------------- search


def refine(residuals, start, low, high):
    """A least-squares descent within bounds; the derivative by forward differences."""

    def jacobian(x):
        step = np.where(x + 1e-6 > high, -1e-6, 1e-6)
        here = residuals(x)
        moved = (residuals(x + step[i] * np.eye(len(x))[i]) for i in range(len(x)))
        return np.column_stack([(one - here) / step[i] for i, one in enumerate(moved)])

    inside = np.clip(start, low + 1e-9, high - 1e-9)
    found = least_squares(residuals, inside, jacobian, (low, high), max_nfev=25, xtol=1e-6, ftol=1e-8)
    return found.cost, found.x


def polish(residuals, start, low, high):
    """Nelder-Mead to the last digits."""
    squares = lambda x: np.sum(residuals(x) ** 2)  # noqa: E731
    options = {"xatol": 1e-7, "fatol": 1e-12 * squares(start), "maxfev": 200}
    options["initial_simplex"] = np.vstack([start, start + 0.02 * np.eye(len(start))])
    found = minimize(squares, start, method="Nelder-Mead", bounds=list(zip(low, high)), options=options)
    return found.fun, found.x


def search(residuals, candidates, low, high):
    """The smallest sum of squares from the best candidates (already sorted by preference)."""
    found = [refine(residuals, np.asarray(start, float), low, high) for start in candidates]
    found.sort(key=lambda one: one[0])
    best, distinct = [], []
    for _, x in found:
        if len(distinct) < 3 and all(np.abs(x - other).max() > 1e-3 for other in distinct):
            distinct.append(x)
            best.append(polish(residuals, x, low, high))
    return min(best, key=lambda one: one[0])


def spectral_peaks(rig, count=3):
    """Angular frequencies of the largest peaks of the angle's spectrum, of all recordings."""
    power, grid = 0.0, np.linspace(0, math.pi / rig.interval, 4097)[1:]
    for r in range(rig.count):
        mask = rig.recording == r
        t, angle = rig.time[mask], rig.angle[mask]
        even = np.arange(0, t[-1], rig.interval)
        values = np.interp(even, t, angle)
        values = (values - values.mean()) * np.hanning(len(values))
        size = 2 ** math.ceil(math.log2(4 * len(values)))
        own = np.abs(np.fft.rfft(values, size)) ** 2
        power = power + np.interp(grid, 2 * math.pi * np.fft.rfftfreq(size, rig.interval), own)
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]))
    return grid[sorted(peaks, key=lambda i: -power[i])[:count]]


def best_starts(rig, squares):
    """Twenty starts (log c, log k): minima of the grid, spectral peaks, then the best others."""
    decades = math.log10(10 * rig.longest / (rig.interval / 3))
    count = math.ceil(SCALES_PER_DECADE * decades) + 1
    rates = np.geomspace(0.1 / rig.longest, 3 / rig.interval, count)
    point = lambda rate, ratio: (math.log(2 * ratio * rate), 2 * math.log(rate))  # noqa: E731
    cost = np.array([[squares(point(rate, ratio)) for ratio in DAMPING_RATIOS] for rate in rates])
    around = np.pad(cost, 1, constant_values=np.inf)
    rows, columns = cost.shape
    shifts = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    lowest = np.min([around[i:i + rows, j:j + columns] for i, j in shifts], axis=0)
    at = sorted(np.ndindex(cost.shape), key=lambda ij: cost[ij])
    minima = [ij for ij in at if cost[ij] <= lowest[ij]]
    peaks = [point(rate, ratio) for rate in spectral_peaks(rig) for ratio in (0.002, 0.02, 0.1, 0.5)]
    starts = [point(rates[i], DAMPING_RATIOS[j]) for i, j in minima[: STARTS // 2]]
    starts += sorted(peaks, key=squares)[: STARTS // 4]
    for i, j in at:
        other = point(rates[i], DAMPING_RATIOS[j])
        if len(starts) < STARTS and other not in starts:
            starts.append(other)
    return starts


def fit_first_order(rig):
    """Rate 1/tau with the smallest error; 0 is the integrator."""
    residuals = lambda x: residual(rig, first_order(rig, math.exp(x[0])))  # noqa: E731
    low, high = np.array([math.log(0.01 / rig.longest)]), np.array([math.log(100 / rig.interval)])
    grid = np.linspace(low[0], high[0], 100)
    cost = [np.sum(residuals([x]) ** 2) for x in grid]
    starts = [grid[i] for i in sorted(range(100), key=lambda i: cost[i])
              if cost[i] <= min(cost[max(i - 1, 0):i + 2])]
    squares, x = search(residuals, [[start] for start in starts[:STARTS]], low, high)
    integrator = np.sum(residual(rig, first_order(rig, 0.0)) ** 2)
    return (squares, math.exp(x[0])) if squares < integrator else (integrator, 0.0)


def fit_second_order(rig, first_rate, offset_each=False):
    """(sum of squares, c, k) with the smallest error."""
    error = lambda c, k: residual(rig, second_order(rig, c, k), offset_each)  # noqa: E731
    slowest, fastest = 0.01 / rig.longest, 1e5 / rig.interval
    c_range, k_range = np.log([slowest / 100, fastest]), np.log([slowest**2, fastest**2])
    c_grid = np.linspace(*c_range, 100)
    ends = lambda *ranges: np.array(ranges, float).T  # noqa: E731
    found = []

    def along(axis, residuals, bounds, result):
        """A search over one parameter, from the five best points of a grid."""
        starts = sorted(axis, key=lambda x: np.sum(residuals([x]) ** 2))[:5]
        squares, x = search(residuals, [[start] for start in starts], *ends(bounds))
        found.append((squares, *result(math.exp(x[0]))))

    held = rig.held_stiffness
    if held is None:
        residuals = lambda x: error(math.exp(x[0]), math.exp(x[1]))  # noqa: E731
        starts = best_starts(rig, lambda x: np.sum(residuals(x) ** 2))
        if first_rate > 0:
            starts.append((math.log(fastest), math.log(fastest * first_rate)))
        squares, x = search(residuals, starts, *ends(c_range, k_range))
        found.append((squares, math.exp(x[0]), math.exp(x[1])))
        along([2 * math.log(peak) for peak in spectral_peaks(rig)] + list(np.linspace(*k_range, 200)),
              lambda x: error(0.0, math.exp(x[0])), k_range, lambda k: (0.0, k))
        held = 0.0
    along(c_grid, lambda x: error(math.exp(x[0]), held), c_range, lambda c: (c, held))
    found.append((np.sum(error(0.0, held or tiny(rig, 0.0)) ** 2), 0.0, held))
    return min(found, key=lambda one: one[0])


def fit_rig(folder):
    """The entry of one rig in the JSON file."""
    rig = Rig(folder)
    samples = len(rig.angle)
    first_squares, rate = fit_first_order(rig)
    squares, c, k = fit_second_order(rig, rate)
    each = squares if rig.count == 1 and rig.has_offset else fit_second_order(rig, rate, True)[0]
    gain, offset, states, simulated = coefficients(rig, second_order(rig, c, k or tiny(rig, c)))
    error = math.sqrt(squares / samples)
    # Two ways to the same number, of which one is a plain simulation.
    if abs(rms(rig.angle - simulated) - error) > 1e-5 * error + 1e-9 * rig.about_mean():
        raise SystemExit(f"{folder}: {rms(rig.angle - simulated)} by simulation, {error} by projection")
    first_gain, first_offset, _, _ = coefficients(rig, first_order(rig, rate))
    per = lambda value: None if value is None else value / (rate or 1.0)  # noqa: E731
    pair = np.sort_complex(np.roots([1.0, c, k]))
    return rounded({
        "rmse_deg": {
            "second_order": error,
            "first_order": math.sqrt(first_squares / samples),
            "second_order_offset_each": math.sqrt(each / samples),
        },
        "about_mean_deg": rig.about_mean(),
        "about_own_means_deg": rig.about_own_means(),
        "samples": samples,
        "recordings": rig.count,
        "c_per_s": c,
        "k_per_s2": k,
        "gain_deg_per_s2_kpa": gain,
        "offset_deg_per_s2": offset,
        "poles_per_s": [[float(pole.real) + 0.0, float(pole.imag) + 0.0] for pole in pair],
        "first_order": {
            "tau_s": 1 / rate if rate else None,
            "gain_deg_per_kpa" if rate else "gain_deg_per_s_kpa": per(first_gain),
            "offset_deg" if rate else "offset_deg_per_s": per(first_offset),
        },
        "initial": "free per recording",
    })


def tiny(rig, c):
    """The spring that stands for none. Without damping, the modes would coincide at 0."""
    return 0.0 if c else (1e-4 / rig.longest) ** 2


def rounded(value):
    """Six significant digits: more would differ between computers."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [rounded(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


# ---------------------------------------------------------------- simulated rigs


def steps(levels, seconds, interval):
    """Each level for so many seconds."""
    return np.repeat(np.array(levels, float), round(seconds / interval))


def ramps(corners, seconds, interval):
    """From corner to corner, each leg so many seconds."""
    legs = np.arange(len(corners)) * seconds
    return np.interp(np.arange(0, legs[-1], interval), legs, corners)


def laboratory():
    """Six linear rigs as a laboratory would record them.

    `pressures` drive the recordings, which begin at `initial` (angle, rate). The sensors
    add their bias and white noise. `guess` is what model.toml says: damping, stiffness
    and gain, wrong by orders of magnitude.
    """
    staircase = [0, 20, 0, 40, 0, 60, 0, 80, 0, 50, 20, 0]
    return {
        "slow_soft_actuator": {
            "about": "quasi-static: first order with tau = 1 s, slow ramps for 20 minutes",
            "seed": 101, "interval": 0.2, "tau": 1.0, "static_gain": 0.45,
            "pressures": [ramps([0, 100, 0, 60, 60, 0], 240, 0.2)],
            "angle_noise": 0.2, "angle_bias": 1.5, "pressure_noise": 0.1, "pressure_bias": 0.4,
            "guess": (0.02, 400.0, 2.0),
        },
        "light_pendulum": {
            "about": "free decay of a lightly damped pendulum at small angles",
            "seed": 102, "interval": 0.02, "c": 0.04, "k": 25.0, "g": None,
            "pressures": [np.zeros(3000), np.zeros(2500)], "initial": [(18.0, 0.0), (-7.0, 20.0)],
            "angle_noise": 0.05, "angle_bias": 0.3, "guess": (3.0, 0.5, 1.0),
        },
        "overdamped_steps": {
            "about": "steps of a heavily overdamped rig, poles at 0.5 and 200 per second",
            "seed": 103, "interval": 0.02, "c": 200.5, "k": 100.0, "g": 60.0,
            "pressures": [steps(staircase, 10, 0.02)],
            "angle_noise": 0.1, "angle_bias": -0.8, "pressure_noise": 0.1, "pressure_bias": 0.2,
            "guess": (1.0, 2.0, 0.01),
        },
        "coarse_resonance": {
            "about": "resonance at 8 Hz, sampled at 20 Hz",
            "seed": 104, "interval": 0.05, "c": 2.0, "k": 2526.6, "g": 1500.0,
            "pressures": [steps([0, 30, 0, 50, 10, 40], 4, 0.05), steps([0, 60, 20, 0, 35], 4, 0.05)],
            "angle_noise": 0.1, "angle_bias": 0.5, "guess": (40.0, 10.0, 1.0),
        },
        "negative_gain": {
            "about": "the sensor is mounted the other way round: the angle falls with the pressure",
            "seed": 105, "interval": 0.02, "c": 2.4, "k": 9.0, "g": -6.0,
            "pressures": [steps(staircase, 6, 0.02)],
            "angle_noise": 0.15, "angle_bias": 2.0, "pressure_bias": -0.3, "guess": (0.01, 300.0, 0.05),
        },
        "motor_without_spring": {
            "about": "a motor: the input sets a rate, nothing brings the angle back",
            "seed": 106, "interval": 0.01, "c": 5.0, "k": 0.0, "g": 8.0,
            "pressures": [steps([0, 40, 0, -40, 20, -60, 0, 30, 0], 2, 0.01)],
            "angle_noise": 0.1, "angle_bias": 5.0, "pressure_bias": 0.2, "guess": (500.0, 50.0, 0.1),
        },
    }


def simulate(folder):
    """Writes the recordings and model files of the six rigs."""
    for name, rig in laboratory().items():
        where = folder / name
        (where / "recordings").mkdir(parents=True, exist_ok=True)
        damping, stiffness, gain = rig["guess"]
        driven = "tau" in rig or rig["g"] is not None
        free = '["damping", "stiffness", "input_gain"]' if driven else '["damping", "stiffness"]'
        (where / "model.toml").write_text(
            f'schema = 1\nname = "{name}"\n\n[dynamics]\ninertia_kg_m = 1.0\n'
            f"damping_n_s_per_rad = {damping}\nstiffness_n_per_rad_n = {stiffness}\n"
            f"exponent = 1.0\ninput_gain_n_per_kpa = {gain}\n\n[fit]\nfree = {free}\n")
        for r, (true_pressure, true_angle) in enumerate(true_recordings(rig)):
            random = np.random.default_rng([rig["seed"], r])
            noise = random.standard_normal((2, len(true_angle)))
            angle = true_angle + rig["angle_bias"] + rig["angle_noise"] * noise[0]
            pressure = true_pressure
            if driven:
                pressure = pressure + rig.get("pressure_bias", 0) + rig.get("pressure_noise", 0) * noise[1]
            seconds = rig["interval"] * np.arange(len(angle))
            rows = np.column_stack([seconds, pressure, angle])
            header = "time_s,pressure_kpa,angle_deg"
            path = where / "recordings" / f"run{r + 1}.csv"
            np.savetxt(path, rows, fmt=("%.3f", "%.5f", "%.5f"), delimiter=",", header=header, comments="")


def true_recordings(rig):
    """Pressure and angle without sensors, by SciPy's own simulation of linear systems."""
    if "tau" in rig:
        system = ([rig["static_gain"]], [rig["tau"], 1.0])
    else:
        c, k, g = rig["c"], rig["k"], rig["g"] or 0.0
        system = ([[0.0, 1.0], [-k, -c]], [[0.0], [g]], [[1.0, 0.0]], [[0.0]])
    initial = rig.get("initial", [None] * len(rig["pressures"]))
    for pressure, state in zip(rig["pressures"], initial):
        seconds = rig["interval"] * np.arange(len(pressure))
        yield pressure, lsim(system, pressure, seconds, state)[1]


def fit_simulated():
    """The entries of the simulated rigs, fitted from the files that --simulate writes."""
    entries = {}
    with tempfile.TemporaryDirectory() as folder:
        simulate(pathlib.Path(folder))
        for name, rig in laboratory().items():
            truth = {"angle_noise_deg": rig["angle_noise"]}
            if "tau" in rig:
                truth |= {"tau_s": rig["tau"], "gain_deg_per_kpa": rig["static_gain"]}
            else:
                truth |= {"c_per_s": rig["c"], "k_per_s2": rig["k"], "gain_deg_per_s2_kpa": rig["g"]}
            fitted = fit_rig(pathlib.Path(folder) / name)
            entries[name] = {"about": rig["about"], "truth": truth} | fitted
            print_row(f"simulated/{name}", entries[name])
    return entries


# ---------------------------------------------------------------- self-check


def check(data):
    """Against SciPy: the exact step, and found parameters integrated as a differential equation."""
    worst = 0.0
    for c, k, h in [(0.3, 4.0, 0.1), (2.0, 1.0, 0.1), (1e5, 3.0, 0.02), (5.0, 0.0, 0.01), (1e-6, 1e-9, 1.0)]:
        # The augmented system integrates a pressure of 1 + t/h as well.
        matrix = np.zeros((4, 4))
        matrix[0, 1], matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[2, 3] = 1, -k, -c, 1, 1
        exact = expm(matrix * h) @ np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1 / h]]).T
        rig = object.__new__(Rig)
        rig.time, rig.steps = np.array([0.0, h]), np.array([0.0, h])
        rig.which_step, rig.starts = np.array([0, 1]), np.array([0])
        rig.pressure, rig.has_gain = np.array([1.0, 2.0]), True
        initial, by_offset, by_pressure = second_order(rig, c, k)
        ours = [initial[0][1], initial[1][1], by_offset[1], by_pressure[1]]
        worst = max(worst, *(abs(a / b - 1) for a, b in zip(ours, exact[0])))
    print(f"one step, five systems: at most {worst:.1e} from expm, relative")
    failed = worst > 1e-8
    for name in ("rigs/cavatappi1", "rigs/laas_elbow", "rigs/rlc_step"):
        folder = data / name
        if not folder.exists():
            print(f"{name}: not there, not checked")
            continue
        rig = Rig(folder)
        _, c, k = fit_second_order(rig, fit_first_order(rig)[1])
        gain, offset, states, simulated = coefficients(rig, second_order(rig, c, k or tiny(rig, c)))
        integrated = integrate(rig, c, k, gain, offset, states)
        here, there = rms(rig.angle - simulated), rms(rig.angle - integrated)
        print(f"{name}: RMS error {here:.6f} deg, {there:.6f} by solve_ivp")
        failed |= abs(here / there - 1) > 1e-5
    return 1 if failed else 0


def integrate(rig, c, k, gain, offset, states):
    """The angle by solve_ivp, sample by sample so that no step crosses a kink of the pressure."""
    angle = np.empty_like(rig.angle)
    for r in range(rig.count):
        (at,) = np.nonzero(rig.recording == r)
        state, angle[at[0]] = states[r], states[r][0]
        for i in at[1:]:
            begin, end = rig.time[i - 1], rig.time[i]
            slope = (rig.pressure[i] - rig.pressure[i - 1]) / (end - begin)

            def rate(t, x):
                pressure = rig.pressure[i - 1] + slope * (t - begin)
                return [x[1], -c * x[1] - k * x[0] + (gain or 0) * pressure + (offset or 0)]

            found = solve_ivp(rate, (begin, end), state, "LSODA", rtol=1e-9, atol=1e-10)
            state = found.y[:, -1]
            angle[i] = state[0]
    return angle


# ---------------------------------------------------------------- command line


def print_row(name, entry):
    error = entry["rmse_deg"]
    figures = (entry["about_mean_deg"], error["first_order"], error["second_order"],
               error["second_order_offset_each"])
    print(f"{name:32}" + "".join(f"{figure:12.5g}" for figure in figures), flush=True)


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    default = root.parent / "shared" / "data"
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, default=default, metavar="DIR",
                        help="folder with rigs/ and real/ (default: ../shared/data beside the repository)")
    parser.add_argument("--rig", action="append", metavar="NAME",
                        help="only this rig, such as rigs/rlc_step or simulated; may be repeated")
    parser.add_argument("-o", "--output", type=pathlib.Path, metavar="FILE.json",
                        help="write the figures; with --rig, those of the other rigs there are kept")
    parser.add_argument("--simulate", type=pathlib.Path, metavar="DIR",
                        help="write recordings and model files of six simulated rigs, and stop")
    parser.add_argument("--check", action="store_true", help="compare with SciPy, and stop")
    arguments = parser.parse_args()
    if arguments.simulate:
        return simulate(arguments.simulate)
    if arguments.check:
        return check(arguments.data)
    began = time.time()
    folders = sorted(path.parent for part in ("rigs", "real")
                     for path in (arguments.data / part).glob("*/model.toml"))
    names = {f"{folder.parent.name}/{folder.name}": folder for folder in folders}
    wanted = arguments.rig or [*names, "simulated"]
    if unknown := set(wanted) - {*names, "simulated"}:
        parser.error(f"not in {arguments.data}: {', '.join(sorted(unknown))}")
    content = {"about": ABOUT, "rigs": {}, "simulated": {}}
    if arguments.rig and arguments.output and arguments.output.exists():
        content |= json.loads(arguments.output.read_text()) | {"about": ABOUT}
    print(f"{'RMS (deg)':32}{'about mean':>12}{'first':>12}{'second':>12}{'offset each':>12}")
    for name in wanted:
        if name == "simulated":
            content["simulated"] = fit_simulated()
        else:
            content["rigs"][name] = fit_rig(names[name])
            print_row(name, content["rigs"][name])
    if arguments.output:
        content["rigs"] = dict(sorted(content["rigs"].items()))
        arguments.output.write_text(json.dumps(content, indent=1) + "\n")
    print(f"{time.time() - began:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
