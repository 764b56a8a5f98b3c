"""PySINDy and softrig on the same recordings: pip install pysindy scipy; python sindy.py

Steps of pressure to three angles, three runs each, a staircase and a triangle of a simulated
actuator that hides an effect. The second run of each step is held out, and both are judged by the
RMS error (degrees) of a simulation over its pressure.

PySINDy is given the angle and its rate, smoothed by a Savitzky-Golay filter, and the pressure as
control, with all products up to the third degree. Of the smoothing windows the one that does best
on the held-out runs is taken, which is more than softrig is allowed.
"""

import sys
import warnings

import numpy as np
import pysindy
import softrig
from scipy.signal import savgol_filter

SEED = 2
WINDOWS = [11, 21, 31, 61, 101]  # samples of 10 ms


def states(run, window):
    """The angle (rad), its rate (rad/s), and the pressure (100 kPa) as a column."""
    step = float(np.median(np.diff(run.time_s)))
    angle = savgol_filter(run.angle_deg, window, 3)
    rate = savgol_filter(run.angle_deg, window, 3, deriv=1, delta=step)
    return np.radians(np.column_stack([angle, rate])), run.pressure_kpa[:, None] / 100


def sindy(runs, window):
    library = pysindy.PolynomialLibrary(degree=3)
    model = pysindy.SINDy(
        feature_library=library,
        optimizer=pysindy.STLSQ(threshold=0.05, alpha=1e-3),
        differentiation_method=pysindy.SmoothedFiniteDifference(
            smoother_kws={"window_length": window}
        ),
    )
    angles, pressures = zip(*(states(run, window) for run in runs))
    times = [run.time_s - run.time_s[0] for run in runs]
    model.fit(list(angles), t=times, u=list(pressures), feature_names=["th", "w", "p"])
    return model, np.array(library.powers_)


def error(model, powers, run, window):
    """RMS error (degrees) of a simulation. `model.simulate` computes the same in a minute: it asks
    for the interpolated pressure thousands of times."""
    coefficients = model.coefficients()
    start, pressure = states(run, window)
    step = float(np.median(np.diff(run.time_s)))

    def rate(state, p):
        return coefficients @ np.prod(np.array([*state, p]) ** powers, axis=1)

    state, angles = start[0], [start[0][0]]
    for now, then in zip(pressure[:-1, 0], pressure[1:, 0]):
        k1 = rate(state, now)
        k2 = rate(state + step / 2 * k1, (now + then) / 2)
        k3 = rate(state + step / 2 * k2, (now + then) / 2)
        k4 = rate(state + step * k3, then)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if not np.all(np.abs(state) < 1e3):
            return np.inf
        angles.append(state[0])
    return rms(np.degrees(angles) - run.angle_deg)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def main(effects):
    print(f"{'hidden':20}{'refitted':>10}{'PySINDy':>10}{'terms':>7}{'softrig':>10}  its answer")
    for effect in effects:
        made = softrig.example(SEED, effect=effect)
        fitted = [run for run in made.recordings if not run.name.endswith("_2")]
        held_out = [run for run in made.recordings if run.name.endswith("_2")]
        tried = []
        for window in WINDOWS:
            model, powers = sindy(fitted, window)
            errors = [error(model, powers, run, window) for run in held_out]
            tried.append((rms(errors), model.complexity))
        best, terms = min(tried)
        found = softrig.diagnose(made.model, fitted, holdout=held_out)
        left = found.verdict.holdout_rmse_deg
        named = " + ".join(found.effects) or found.answer
        print(f"{effect:20}{left.refit:10.2f}{best:10.2f}{terms:7}{left.repaired:10.2f}  {named}")


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    main(sys.argv[1:] or ["quadratic_damping", "coulomb_friction", "maxwell_branch"])
