"""Black-box models on the same split as a diagnosis: ARX and polynomial NARX.

Usage: black_box.py --fit RUN.csv … --holdout RUN.csv … [--json OUT.json]
       black_box.py --self-check

What `softrig diagnose` has to be compared with: a model without any physics, whose
orders are chosen on the fitted recordings alone. Both models are judged by free-run
simulation of the validation recordings, from as many measured samples as their
order. Errors are RMS in degrees, at the times of the recorded samples.

ARX    y(k) = c + Σ aᵢ y(k−i) + Σ bⱼ u(k−j), least squares; orders by the BIC of the
       one-step error, sampling rate by free-run error in cross-validation.
NARX   the same with all monomials of these regressors up to degree 3; terms by
       forward selection, then refined on the free-run error. Lags, degree, number of
       terms and sampling rate by free-run error in cross-validation.

Recordings of several sampling rates are brought to the slowest of the fitted ones, and
to a half and a quarter of it. Cross-validation leaves out one recording at a time, or
the last third of the only one.
"""

import argparse
import csv
import itertools
import json
import os
import sys
import time

# Before numpy starts its threads: times are those of one core.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_variable] = "1"

import numpy as np  # noqa: E402

# Slower rates that are tried, as multiples of the slowest fitted sampling interval.
RATE_FACTORS = (1, 2, 4)
# Fitted samples that a slower rate must leave.
FEWEST_SAMPLES = 30
# Largest orders of the ARX model: past outputs, inputs.
ARX_LARGEST = (6, 6)
# Past outputs and inputs of the NARX candidates.
NARX_LAGS = ((1, 1), (2, 1), (2, 2), (3, 3))
NARX_DEGREES = (1, 2, 3)
NARX_TERMS = (3, 4, 5, 6, 8, 10, 13, 16, 20, 25)
# Candidates that are refined on their free-run error.
REFINED = 3
REFINE_STEPS = 12
# A simulation this many standard deviations from the mean of the fitted angles has
# diverged.
DIVERGED = 20.0
# Prior standard deviations of what may be estimated on a validation recording. The zeros
# of the sensors as in `softrig` (kPa, degrees); the start's angle (degrees) and rate
# (degrees/s) are as good as free.
FREEDOM_SD = (0.5, 2.0, 1e3, 1e4)
# A zero lies within so many standard deviations, as in `softrig`.
FARTHEST = 3.0


class Run:
    """One recording: times (s), input (kPa) and output (degrees)."""

    def __init__(self, t, u, y):
        self.t, self.u, self.y = (np.asarray(a, float) for a in (t, u, y))

    @staticmethod
    def read(path):
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        columns = ("time_s", "pressure_kpa", "angle_deg")
        run = Run(*([float(row[name]) for row in rows] for name in columns))
        if len(run.t) < 4:
            raise SystemExit(f"{path}: {len(run.t)} samples are too few")
        return run

    def interval(self):
        return float(np.median(np.diff(self.t)))

    def at_rate(self, dt):
        """The run at equal intervals: input averaged over each, output interpolated."""
        steps = np.diff(self.t)
        if np.all(np.abs(steps - dt) < 0.01 * dt):
            return self
        count = int(np.floor((self.t[-1] - self.t[0]) / dt * (1 + 1e-9))) + 1
        t = self.t[0] + dt * np.arange(count)
        if dt <= self.interval() * 1.01:
            u = np.interp(t, self.t, self.u)
        else:
            middle = 0.5 * (self.u[1:] + self.u[:-1])
            area = np.concatenate([[0.0], np.cumsum(middle * steps)])
            low = np.clip(t - dt / 2, self.t[0], self.t[-1])
            high = np.clip(t + dt / 2, self.t[0], self.t[-1])
            u = (np.interp(high, self.t, area) - np.interp(low, self.t, area)) / (high - low)
        return Run(t, u, np.interp(t, self.t, self.y))

    def part(self, start, end):
        return Run(self.t[start:end], self.u[start:end], self.y[start:end])


class Scale:
    """Mean and standard deviation of the fitted recordings."""

    def __init__(self, runs):
        u = np.concatenate([run.u for run in runs])
        y = np.concatenate([run.y for run in runs])
        self.u0, self.y0, self.y1 = u.mean(), y.mean(), y.std() or 1.0
        spread = u.std()
        self.has_input = spread > 1e-9 * max(1.0, abs(self.u0))
        self.u1 = spread if self.has_input else 1.0

    def u(self, u):
        return (u - self.u0) / self.u1

    def y(self, y):
        return (y - self.y0) / self.y1

    def degrees(self, y):
        return self.y0 + self.y1 * y


class Structure:
    """Terms: products of at most three of 1, past outputs and inputs."""

    def __init__(self, outputs, inputs, terms):
        # Lags of the outputs, from 1, and of the inputs, from 0.
        self.outputs, self.inputs = tuple(outputs), tuple(inputs)
        self.terms = np.asarray(terms, int).reshape(-1, 3)
        self.start = max((*self.outputs, *self.inputs, 1))

    @staticmethod
    def linear(na, inputs):
        regressors = 1 + na + len(inputs)
        return Structure(range(1, na + 1), inputs, [(i, 0, 0) for i in range(regressors)])

    @staticmethod
    def polynomial(na, inputs, degree):
        # Regressor 0 is the constant, so that lower degrees are among the products.
        regressors = 1 + na + len(inputs)
        terms = itertools.combinations_with_replacement(range(regressors), degree)
        terms = [(*reversed(term), 0, 0)[:3] for term in terms]
        return Structure(range(1, na + 1), inputs, terms)

    def only(self, kept):
        return Structure(self.outputs, self.inputs, self.terms[list(kept)])

    def products(self, x):
        i, j, k = self.terms.T
        return x[..., i] * x[..., j] * x[..., k]

    def rows(self, scale, runs):
        """Regression matrix and targets of the one-step error."""
        matrices, targets = [], []
        for run in runs:
            u, y = scale.u(run.u), scale.y(run.y)
            n = len(y)
            if n <= self.start:
                continue
            columns = [np.ones(n - self.start)]
            columns += [y[self.start - lag : n - lag] for lag in self.outputs]
            columns += [u[self.start - lag : n - lag] for lag in self.inputs]
            matrices.append(self.products(np.stack(columns, -1)))
            targets.append(y[self.start :])
        return np.concatenate(matrices), np.concatenate(targets)

    def simulate(self, coefficients, inputs, starts):
        """Free run of many models side by side: one row of each argument a model.

        `starts` holds the first measured outputs. Values are cut off far outside the
        data, so that a model that diverges stays a number.
        """
        models, samples = inputs.shape
        y = np.zeros((models, samples))
        y[:, : self.start] = starts[:, : self.start]
        x = np.ones((models, 1 + len(self.outputs) + len(self.inputs)))
        past = np.array(self.outputs)
        driven = np.array(self.inputs, int)
        first_input = 1 + len(self.outputs)
        i, j, k = self.terms.T
        is_linear = not (j.any() or k.any())
        for n in range(self.start, samples):
            x[:, 1:first_input] = y[:, n - past]
            if driven.size:
                x[:, first_input:] = inputs[:, n - driven]
            terms = x[:, i] if is_linear else x[:, i] * x[:, j] * x[:, k]
            value = np.einsum("mt,mt->m", terms, coefficients)
            y[:, n] = np.clip(value, -5 * DIVERGED, 5 * DIVERGED)
        return y


class Model:
    """A structure with coefficients, at one sampling interval."""

    def __init__(self, structure, coefficients, scale, dt):
        self.structure, self.coefficients = structure, np.asarray(coefficients, float)
        self.scale, self.dt = scale, dt

    def free_run(self, runs):
        """Errors (degrees) at the recorded samples of each run, without those that the
        simulation starts from; infinite if it diverges."""
        slow = [run.at_rate(self.dt) for run in runs]
        inputs, starts = padded(self.structure, self.scale, slow)
        many = np.tile(self.coefficients, (len(runs), 1))
        y = self.structure.simulate(many, inputs, starts)
        return [error_at_samples(self, run, at, row) for run, at, row in zip(runs, slow, y)]

    def free_runs_with(self, run, freedoms):
        """The same for one run and several rows of zeros and starts, one result a row."""
        slow = run.at_rate(self.dt)
        inputs, starts = padded(self.structure, self.scale, [slow])
        input_zero, angle_zero, angle, rate = (column[:, None] for column in np.array(freedoms).T)
        since = self.dt * np.arange(starts.shape[1])
        inputs = inputs - input_zero / self.scale.u1
        starts = starts + (angle - angle_zero + rate * since) / self.scale.y1
        many = np.tile(self.coefficients, (len(freedoms), 1))
        y = self.structure.simulate(many, inputs, starts)
        errors = [error_at_samples(self, run, slow, row) for row in y]
        return np.stack(errors) + angle_zero


def padded(structure, scale, runs):
    """Inputs and first outputs of runs as rows of equal length."""
    longest = max(len(run.u) for run in runs)
    inputs = np.stack([np.pad(scale.u(r.u), (0, longest - len(r.u)), "edge") for r in runs])
    first = structure.start
    starts = np.stack([np.resize(scale.y(r.y[:first]), first) for r in runs])
    return inputs, starts


def error_at_samples(model, run, slow, y):
    y = y[: len(slow.t)]
    if np.abs(y).max() > DIVERGED:
        return np.full(len(run.t), np.inf)
    simulated = model.scale.degrees(np.interp(run.t, slow.t, y))
    first = slow.t[min(model.structure.start, len(slow.t)) - 1]
    after = (run.t > first + 1e-9) & (run.t <= slow.t[-1] + 1e-9)
    return (simulated - run.y)[after]


def rms(errors):
    errors = np.concatenate(errors)
    if not errors.size:
        return np.inf
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean(errors**2)))


def folds(runs):
    """Fitted and left-out recordings of each fold."""
    if len(runs) > 1:
        return [(runs[:i] + runs[i + 1 :], [runs[i]]) for i in range(len(runs))]
    cut = 2 * len(runs[0].t) // 3
    return [([runs[0].part(0, cut)], [runs[0].part(cut, None)])]


def intervals(runs):
    slowest = max(run.interval() for run in runs)
    duration = sum(run.t[-1] - run.t[0] for run in runs)
    tried = [factor * slowest for factor in RATE_FACTORS]
    return [dt for dt in tried if dt == slowest or duration / dt > FEWEST_SAMPLES]


def least_squares(matrix, target):
    return np.linalg.lstsq(matrix, target, rcond=1e-12)[0]


def cross_validated(runs, fit):
    """Free-run error (degrees) of what `fit` makes of each fold."""
    return rms([e for kept, left in folds(runs) for e in fit(kept).free_run(left)])


# --- ARX -----------------------------------------------------------------------------


def arx_structures(has_input, na_largest):
    for na in range(1, na_largest + 1):
        if not has_input:
            yield Structure.linear(na, ())
            continue
        for first in (0, 1):
            for count in range(1, ARX_LARGEST[1] + 1):
                yield Structure.linear(na, tuple(range(first, first + count)))


def fit_arx(runs, dt):
    """The ARX model with the lowest one-step BIC."""
    slow = [run.at_rate(dt) for run in runs]
    scale = Scale(slow)
    # All orders are compared on the same samples.
    skip = max(ARX_LARGEST)
    if min(len(run.y) for run in slow) < 3 * skip:
        skip = 2
    best = None
    for structure in arx_structures(scale.has_input, min(ARX_LARGEST[0], skip)):
        if structure.start > skip:
            continue
        drop = skip - structure.start
        matrix, target = structure.rows(scale, [run.part(drop, None) for run in slow])
        coefficients = least_squares(matrix, target)
        n = len(target)
        noise = max(np.mean((matrix @ coefficients - target) ** 2), 1e-20)
        bic = n * np.log(noise) + len(coefficients) * np.log(n)
        if best is None or bic < best[0]:
            best = (bic, structure)
    structure = best[1]
    return Model(structure, least_squares(*structure.rows(scale, slow)), scale, dt)


def arx(runs):
    """The ARX model at the rate with the lowest cross-validated free-run error."""
    tried = [(cross_validated(runs, lambda kept: fit_arx(kept, dt)), dt) for dt in intervals(runs)]
    _, dt = min(tried)
    return fit_arx(runs, dt)


# --- NARX ----------------------------------------------------------------------------


def forward_selection(matrix, target, most):
    """Columns in the order in which they reduce the squared error most."""
    size = np.sqrt(np.mean(matrix**2, axis=0))
    size[size == 0] = 1.0
    rest = matrix / size
    residual = target.copy()
    kept = []
    # A column that the chosen ones nearly span is only noise.
    floor = 1e-10 * np.sum(rest**2, axis=0)
    for _ in range(min(most, matrix.shape[1], matrix.shape[0] // 2)):
        energy = np.sum(rest**2, axis=0)
        gain = (rest.T @ residual) ** 2 / np.maximum(energy, 1e-300)
        gain[energy <= floor] = -1.0
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        kept.append(best)
        direction = rest[:, best] / np.sqrt(energy[best])
        residual = residual - direction * (direction @ residual)
        rest = rest - np.outer(direction, direction @ rest)
    return kept


def fit_terms(full, kept, runs, dt):
    """Models of the first so many terms of a forward selection, one for each number."""
    slow = [run.at_rate(dt) for run in runs]
    scale = Scale(slow)
    matrix, target = full.rows(scale, slow)
    order = forward_selection(matrix, target, max(kept))
    models = []
    for count in kept:
        chosen = order[: min(count, len(order))]
        coefficients = least_squares(matrix[:, chosen], target)
        models.append(Model(full.only(chosen), coefficients, scale, dt))
    return models


def refine(model, runs):
    """Levenberg–Marquardt steps on the free-run error of the fitted recordings."""
    structure, scale = model.structure, model.scale
    slow = [run.at_rate(model.dt) for run in runs]
    inputs, starts = padded(structure, scale, slow)
    measured = [scale.y(run.y) for run in slow]

    def residuals(many):
        """One row a set of coefficients."""
        count = len(many)
        y = structure.simulate(
            np.repeat(many, len(slow), 0), np.tile(inputs, (count, 1)), np.tile(starts, (count, 1))
        ).reshape(count, len(slow), -1)
        first = structure.start
        parts = [y[:, i, first : len(m)] - m[first:] for i, m in enumerate(measured)]
        return np.concatenate(parts, 1)

    at = model.coefficients.copy()
    now = residuals(at[None])[0]
    if not np.all(np.isfinite(now)) or np.abs(now).max() > DIVERGED:
        return model
    damping = 1e-3
    for _ in range(REFINE_STEPS):
        step = 1e-6 * np.maximum(np.abs(at), 1e-2)
        jacobian = (residuals(at + np.diag(step)) - now).T / step
        curvature, slope = jacobian.T @ jacobian, jacobian.T @ now
        before = now @ now
        while damping < 1e8:
            damped = curvature + damping * np.diag(np.diag(curvature) + 1e-12)
            tried = at - np.linalg.lstsq(damped, slope, rcond=1e-14)[0]
            after = residuals(tried[None])[0]
            if after @ after < before:
                break
            damping *= 10.0
        else:
            break
        at, now, damping = tried, after, max(damping / 10.0, 1e-9)
        if before - now @ now < 1e-4 * before:
            break
    return Model(structure, at, scale, model.dt)


def narx(runs):
    """The polynomial model with the lowest cross-validated free-run error."""
    tried = []
    for dt in intervals(runs):
        has_input = Scale(runs).has_input
        seen = set()
        for (na, nb), degree, first in itertools.product(NARX_LAGS, NARX_DEGREES, (0, 1)):
            inputs = tuple(range(first, first + nb)) if has_input else ()
            if (na, inputs, degree) in seen:
                continue
            seen.add((na, inputs, degree))
            full = Structure.polynomial(na, inputs, degree)
            counts = sorted({min(count, len(full.terms)) for count in NARX_TERMS})
            errors = [[] for _ in counts]
            for kept, left in folds(runs):
                for place, model in enumerate(fit_terms(full, counts, kept, dt)):
                    # What diverged in one fold is not tried in the next.
                    if all(np.all(np.isfinite(e)) for e in errors[place]):
                        errors[place] += model.free_run(left)
            tried += [(rms(e), dt, full, count) for e, count in zip(errors, counts)]
    tried.sort(key=lambda candidate: candidate[0])
    # One of each set of regressors: neighbours in size are much the same.
    leaders, shown = [], set()
    for candidate in tried:
        key = (candidate[1], candidate[2].outputs, candidate[2].inputs)
        if key not in shown:
            shown.add(key)
            leaders.append(candidate)

    def fit(kept, dt, full, count, refined):
        model = fit_terms(full, [count], kept, dt)[0]
        return refine(model, kept) if refined else model

    finalists = [(error, place, what, False) for place, (error, *what) in enumerate(leaders)]
    for place, (_, *what) in enumerate(leaders[:REFINED]):
        error = cross_validated(runs, lambda kept: fit(kept, *what, True))
        finalists.append((error, place, what, True))
    # The best that does not diverge on what it was fitted to.
    finalists.sort(key=lambda finalist: (finalist[0], finalist[1], finalist[3]))
    for _, _, what, refined in finalists:
        model = fit(runs, *what, refined)
        if np.isfinite(rms(model.free_run(runs))):
            break
    return model


# --- Judging -------------------------------------------------------------------------


def with_freedom(model, holdout):
    """The RMS error with zeros and start estimated on each validation recording: what
    `softrig diagnose` does with the models that it judges."""
    prior_sd = np.array(FREEDOM_SD)
    step = np.array([0.05, 0.05, 0.05, 0.05])
    wall = np.array([FARTHEST * FREEDOM_SD[0], FARTHEST * FREEDOM_SD[1], np.inf, np.inf])
    errors = []
    for run in holdout:
        at, damping = np.zeros(4), 1e-6
        now = model.free_runs_with(run, [at])[0]
        # The prior counts in units of the error that is left without it.
        noise = np.sqrt(np.mean(now**2))

        def cost(error, at):
            return error @ error + np.sum((noise * at / prior_sd) ** 2)

        while np.isfinite(noise) and damping < 1e6:
            moved = model.free_runs_with(run, at + np.diag(step))
            if not np.all(np.isfinite(moved)):
                break
            jacobian = (moved - now).T / step
            prior = (noise / prior_sd) ** 2
            curvature = jacobian.T @ jacobian + np.diag(prior)
            slope = jacobian.T @ now + prior * at
            before = cost(now, at)
            while damping < 1e6:
                scaled = curvature + np.diag(damping * np.diag(curvature))
                tried = np.clip(at - np.linalg.solve(scaled, slope), -wall, wall)
                after = model.free_runs_with(run, [tried])[0]
                if cost(after, tried) < before:
                    break
                damping *= 10.0
            else:
                break
            at, now, damping = tried, after, max(damping / 10.0, 1e-9)
            noise_now = np.sqrt(np.mean(now**2))
            if before - cost(now, at) < 1e-4 * before:
                break
            noise = noise_now
        errors.append(now)
    return rms(errors)


def judged(make, runs, holdout):
    wall, cpu = time.perf_counter(), time.process_time()
    model = make(runs)
    error = rms(model.free_run(holdout))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    structure = model.structure
    return model, {
        "rms_deg": error if np.isfinite(error) else None,
        "diverges": not np.isfinite(error),
        "rms_with_freedom_deg": finite(with_freedom(model, holdout)),
        "fitted_rms_deg": finite(rms(model.free_run(runs))),
        "output_lags": list(structure.outputs),
        "input_lags": list(structure.inputs),
        "terms": len(structure.terms),
        "degree": int(max(np.count_nonzero(structure.terms, axis=1), default=1)),
        "rate_hz": 1.0 / model.dt,
        "wall_s": wall,
        "cpu_s": cpu,
    }


def finite(value):
    return value if np.isfinite(value) else None


# --- Self-check ----------------------------------------------------------------------


def self_check():
    """Known systems must be found again; a failure ends the program."""
    random = np.random.default_rng(1)

    def made(samples, cubic=0.0, noise=0.0):
        u = np.repeat(random.normal(size=samples // 8 + 1), 8)[:samples]
        y = np.zeros(samples)
        for k in range(2, samples):
            y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + 0.5 * u[k - 1] + 0.2 * u[k - 2]
            y[k] -= cubic * y[k - 1] ** 3
        y += 30 + noise * random.normal(size=samples)
        return Run(0.01 * np.arange(samples), 100 + 10 * u, y)

    def expect(holds, what):
        if not holds:
            raise SystemExit(f"self-check failed: {what}")

    runs, left = [made(400), made(300)], [made(300)]
    model = arx(runs)
    expect(model.structure.outputs == (1, 2), f"ARX outputs {model.structure.outputs}")
    expect(np.isclose(model.dt, 0.01), f"ARX interval {model.dt}")
    scale = model.scale
    found = dict(zip(("c", "y1", "y2"), model.coefficients))
    expect(abs(found["y1"] - 1.5) < 1e-6 and abs(found["y2"] + 0.7) < 1e-6, f"ARX poles {found}")
    gains = dict(zip(model.structure.inputs, model.coefficients[3:] * scale.y1 / scale.u1 * 10))
    expect(abs(gains[1] - 0.5) < 1e-6 and abs(gains[2] - 0.2) < 1e-6, f"ARX gains {gains}")
    expect(rms(model.free_run(left)) < 1e-6, "ARX free run")
    expect(rms(narx(runs).free_run(left)) < 0.02, "NARX on a linear system")

    noisy, quiet = [made(800, noise=0.02), made(600, noise=0.02)], [made(300)]
    expect(rms(arx(noisy).free_run(quiet)) < 0.2, "ARX with noise")

    curved, left = [made(400, 0.01), made(400, 0.01)], [made(300, 0.01)]
    linear, polynomial = (rms(make(curved).free_run(left)) for make in (arx, narx))
    expect(polynomial < 0.02 * linear, f"NARX {polynomial} against ARX {linear} on a cubic")

    # Zeros and a start that are off are found again and taken off.
    model = arx(runs)
    off = made(500)
    off = Run(off.t, off.u + 0.4, off.y + 1.5)
    off.y[0] += 1.0
    plain, free = rms(model.free_run([off])), with_freedom(model, [off])
    expect(free < 0.2 * plain, f"zeros and start {plain} {free}")

    t = 0.01 * np.arange(200)
    slow = Run(t, np.ones(200), np.sin(t)).at_rate(0.04)
    expect(np.allclose(slow.y, np.sin(slow.t), atol=1e-4), "resampled output")
    expect(np.allclose(slow.u, 1.0), "resampled input")

    unstable = Model(Structure.linear(1, ()), [0.0, 1.2], Scale(runs), 0.01)
    expect(not np.isfinite(rms(unstable.free_run(left))), "a model that diverges")
    print("self-check: ok")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--fit", nargs="+", metavar="RUN.csv")
    parser.add_argument("--holdout", nargs="+", metavar="RUN.csv")
    parser.add_argument("--json", metavar="OUT.json")
    parser.add_argument("--self-check", action="store_true")
    arguments = parser.parse_args()
    if arguments.self_check:
        return self_check()
    if not (arguments.fit and arguments.holdout):
        parser.error("give --fit and --holdout, or --self-check")
    runs = [Run.read(path) for path in arguments.fit]
    holdout = [Run.read(path) for path in arguments.holdout]
    every = [run.interval() for run in runs + holdout]
    results = {
        name: judged(make, runs, holdout)[1] for name, make in (("arx", arx), ("narx", narx))
    }
    results["sampled_alike"] = max(every) < 1.01 * min(every)
    text = json.dumps(results, indent=2) + "\n"
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            file.write(text)
    else:
        sys.stdout.write(text)
    return None


if __name__ == "__main__":
    main()
