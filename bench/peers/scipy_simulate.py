"""SciPy and Numba on the problems of bench/src/simulate.rs, beside its times and solutions.

Usage: scipy_simulate.py PROBLEMS.json

The median of several runs counts. "At our error" is SciPy with the largest of the
tolerances below that brings its error down to ours. Numba compiles the method that we
use, with the same spline: what a patient user would write. The reference that errors are measured
against is DOP853 with tolerances of 1e-11 that never steps over a sample.
"""

import json
import statistics
import sys
import time

import numba
import numpy as np
import scipy
from scipy.integrate import solve_ivp

RTOL = 1e-6
ATOL = 1e-9
TIGHTER = (1e-8, 1e-10, 1e-12, 3e-14)
ENOUGH_S = 2.0


def slopes(t, p):
    """Three-point slopes, as ours."""
    secant = np.diff(p) / np.diff(t)
    before, after = np.diff(t)[:-1], np.diff(t)[1:]
    m = np.empty_like(p)
    m[0], m[-1] = secant[0], secant[-1]
    m[1:-1] = (after * secant[:-1] + before * secant[1:]) / (before + after)
    return m


def spline(t, p):
    """The same signal as ours: cubic Hermite with three-point slopes, as scalar code."""
    m = slopes(t, p)
    h, last = t[1] - t[0], len(t) - 2
    p, m = p.tolist(), (m * h).tolist()

    def pressure(at):
        k = min(max(int(at / h), 0), last)
        u = at / h - k
        rise = p[k + 1] - p[k]
        c2, c3 = 3 * rise - 2 * m[k] - m[k + 1], m[k] + m[k + 1] - 2 * rise
        return p[k] + u * (m[k] + u * (c2 + u * c3))

    return pressure


def rate(problem, pressure):
    """The equation of motion as one writes it in Python, without overhead."""
    inertia, damping = problem["inertia"], problem["damping"]
    stiffness, exponent = problem["stiffness"], problem["exponent"]
    gain = problem["input_gain"]

    def f(t, y):
        angle, velocity = y
        restoring = stiffness * abs(angle) ** exponent
        if angle < 0:
            restoring = -restoring
        return [velocity, (gain * pressure(t) - damping * velocity - restoring) / inertia]

    return f


def median(run):
    """The median seconds of a run, and what the last one gave."""
    seconds, began = [], time.perf_counter()
    while len(seconds) < 3 or time.perf_counter() - began < ENOUGH_S:
        one = time.perf_counter()
        found = run()
        seconds.append(time.perf_counter() - one)
    return statistics.median(seconds), found


def timed(f, t, method, rtol=RTOL, atol=ATOL):
    seconds, solution = median(
        lambda: solve_ivp(f, (t[0], t[-1]), [0.0, 0.0], method, t_eval=t, rtol=rtol, atol=atol)
    )
    if not solution.success:
        sys.exit(f"{method}: {solution.message}")
    return seconds, solution


def at_our_error(f, t, truth, error):
    """RK45 with the first tolerance that is as exact as we are, or the tightest."""
    for rtol in TIGHTER:
        seconds, solution = timed(f, t, "RK45", rtol, rtol * 1e-3)
        if np.abs(solution.y[0] - truth).max() <= error:
            break
    return seconds, solution, rtol


@numba.njit
def compiled_rk4(t, p, m, inertia, damping, stiffness, exponent, gain, steps):
    """RK4 at the samples' rate on the cubic Hermite spline with these slopes."""
    angles = np.zeros(len(t))
    x = v = 0.0
    for k in range(len(t) - 1):
        width = t[k + 1] - t[k]
        h = width / steps
        rise, m0, m1 = p[k + 1] - p[k], m[k] * width, m[k + 1] * width
        c2, c3 = 3 * rise - 2 * m0 - m1, m0 + m1 - 2 * rise
        for part in range(steps):
            sum_x = sum_v = 0.0
            dx = dv = 0.0
            for stage in range(4):
                ahead = 0.0 if stage == 0 else h if stage == 3 else 0.5 * h
                u = (part * h + ahead) / width
                pressure = p[k] + u * (m0 + u * (c2 + u * c3))
                xs, vs = x + ahead * dx, v + ahead * dv
                restoring = stiffness * abs(xs) ** exponent
                if xs < 0:
                    restoring = -restoring
                dx, dv = vs, (gain * pressure - damping * vs - restoring) / inertia
                weight = 1.0 if stage == 0 or stage == 3 else 2.0
                sum_x += weight * dx
                sum_v += weight * dv
            x += sum_x * h / 6
            v += sum_v * h / 6
        angles[k + 1] = x
    return angles


def reference(f, t):
    step = t[1] - t[0]
    solution = solve_ivp(
        f, (t[0], t[-1]), [0.0, 0.0], "DOP853", t_eval=t, rtol=1e-11, atol=1e-13, max_step=step
    )
    return solution.y[0]


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        problems = json.load(file)["problems"]
    print(
        f"SciPy {scipy.__version__}, NumPy {np.__version__}, Numba {numba.__version__}, "
        f"rtol {RTOL:g}, atol {ATOL:g}"
    )
    for problem in problems:
        t, p = np.array(problem["time_s"]), np.array(problem["pressure_pa"])
        constant = float(p[0])
        rivals = []
        if problem["pressure_is_constant"]:
            exact = rate(problem, lambda _: constant)
            for method in ("RK45", "LSODA"):
                rivals.append((f"SciPy {method}", exact, method))
        else:
            exact = rate(problem, spline(t, p))
            linear = rate(problem, lambda at: np.interp(at, t, p))
            rivals.append(("SciPy RK45, same spline", exact, "RK45"))
            rivals.append(("SciPy RK45, numpy.interp", linear, "RK45"))
            rivals.append(("SciPy LSODA, same spline", exact, "LSODA"))
        truth = reference(exact, t)
        ours, ours_s = np.array(problem["angle_rad"]), problem["seconds_per_simulation"]
        steps = (len(t) - 1) * problem["steps_between_samples"]

        print(f"\n{problem['name']}: {t[-1]:g} s, {len(t)} samples, to {np.degrees(truth.max()):.1f} deg")
        print(f"  {'solver':<26}{'ms a run':>10}{'times ours':>12}{'max error, deg':>16}{'evaluations':>13}")

        def row(name, seconds, angle, evaluations):
            error = np.degrees(np.abs(angle - truth).max())
            print(f"  {name:<26}{1e3 * seconds:>10.3f}{seconds / ours_s:>12.1f}{error:>16.1e}{evaluations:>13}")

        row("ours, RK4", ours_s, ours, 4 * steps)
        compiled = lambda: compiled_rk4(
            t,
            p,
            slopes(t, p),
            problem["inertia"],
            problem["damping"],
            problem["stiffness"],
            problem["exponent"],
            problem["input_gain"],
            problem["steps_between_samples"],
        )
        compiled()
        row("Numba, the same RK4", *median(compiled), 4 * steps)
        for name, f, method in rivals:
            seconds, solution = timed(f, t, method)
            row(name, seconds, solution.y[0], solution.nfev)
        seconds, solution, rtol = at_our_error(exact, t, truth, np.abs(ours - truth).max())
        row(f"SciPy RK45, rtol {rtol:g}", seconds, solution.y[0], solution.nfev)

        count, with_derivatives = problem["derivatives"], problem["seconds_with_derivatives"]
        print(
            f"  ours with {count} derivatives: {1e3 * with_derivatives:.3f} ms; "
            f"{count + 1} runs for differences would take {1e3 * (count + 1) * ours_s:.3f} ms, "
            f"{(count + 1) * ours_s / with_derivatives:.1f} times as long"
        )


main()
