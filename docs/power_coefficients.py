"""Fits the polynomials of model-core/src/elementary.rs and prints them as Rust.

    python3 docs/power_coefficients.py           # print the constants
    python3 docs/power_coefficients.py --check   # fail unless the source holds them

Each fit is a linear programme: the smallest E such that |P(x) - f(x)| <= E w(x)
on a dense Chebyshev grid, with the exact values that the model needs (2^0 = 1,
2^1 = 2, log2 1 = 0) as equality constraints or as factors. Coefficients are
rounded to f32 one at a time, the most important first, and the remaining ones
are fitted again, so that the printed error is that of the rounded polynomial.
Needs numpy and scipy.
"""

import pathlib
import sys

import numpy as np
from scipy.optimize import linprog

SOURCE = pathlib.Path(__file__).parent.parent / "model-core" / "src" / "elementary.rs"

# One degree less costs more than 10^-6 in each of the first three.
TANH_DEGREE, SIN_DEGREE, COS_DEGREE, NEAR_DEGREE = 3, 2, 2, 2


def chebyshev_grid(low, high, count=3001):
    unit = (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2
    return low + (high - low) * unit


def fit(x, target, weight, degree, value_at=(), upper_at=()):
    """Fits P(x) = sum c_i x^i; `value_at` pins (x, P(x)), `upper_at` bounds it."""
    fixed = {}
    for _ in range(degree + 1):
        free = [i for i in range(degree + 1) if i not in fixed]
        powers = np.vander(x, degree + 1, increasing=True) / weight[:, None]
        rest = target / weight - sum(fixed[i] * powers[:, i] for i in fixed)
        free_powers = powers[:, free]
        # Columns are scaled so that the programme is well conditioned.
        scale = np.abs(free_powers).max(axis=0)
        columns = free_powers / scale
        error_column = -np.ones((len(x), 1))
        # The objective is scaled too: errors near 1e-8 are below the solver's
        # tolerances otherwise.
        unit = 1e-6
        a_ub = [np.hstack([columns / unit, error_column]),
                np.hstack([-columns / unit, error_column])]
        b_ub = [rest / unit, -rest / unit]
        for at, bound in upper_at:
            row = np.array([at**i for i in free]) / scale
            value = bound - sum(fixed[i] * at**i for i in fixed)
            a_ub.append(np.append(row, 0)[None, :] / unit)
            b_ub.append(np.array([value]) / unit)
        a_eq, b_eq = [], []
        for at, pinned in value_at:
            row = np.array([at**i for i in free]) / scale
            # A pin whose coefficients are all rounded is checked by the caller.
            if len(free) > 1:
                a_eq.append(np.append(row, 0) / unit)
                b_eq.append((pinned - sum(fixed[i] * at**i for i in fixed)) / unit)
        result = linprog(
            np.append(np.zeros(len(free)), 1.0),
            A_ub=np.vstack(a_ub), b_ub=np.concatenate(b_ub),
            A_eq=np.array(a_eq) if a_eq else None, b_eq=b_eq if b_eq else None,
            bounds=[(None, None)] * len(free) + [(0, None)],
            method="highs",
        )
        assert result.success, result.message
        first = free[0]
        fixed[first] = float(np.float32(result.x[0] / scale[0]))
    coefficients = np.array([fixed[i] for i in range(degree + 1)])
    error = np.abs(np.vander(x, degree + 1, increasing=True) @ coefficients - target) / weight
    return coefficients, error.max()


def literal(value):
    """Writes an f32 the way clippy wants it: shortest digits, in groups of three."""
    text = np.format_float_positional(np.float32(value), unique=True, trim="0")
    whole, fraction = text.split(".")
    groups = [fraction[i : i + 3] for i in range(0, len(fraction), 3)]
    return whole + "." + "_".join(groups)


def split_half_pi(bits_each, parts):
    """Cuts pi/2 into parts of few bits, so that small multiples are exact."""
    # pi/2 to 80 bits, as an integer, from the hexadecimal digits of pi.
    pi_bits = 0x3243F6A8885A308D313198A2E0370734  # pi * 2^124
    remaining, shift = pi_bits, 125  # pi/2 = pi_bits / 2^125
    pieces = []
    for index in range(parts):
        bits = 24 if index == parts - 1 else bits_each
        drop = remaining.bit_length() - bits
        kept = (remaining + (1 << (drop - 1)) if index == parts - 1 else remaining) >> drop
        pieces.append(float(kept) * 2.0 ** (drop - shift))
        remaining -= kept << drop
    return pieces


def main():
    constants = []

    def emit(name, coefficients, error, what):
        print(f"// {what}: maximum error {error:.2e}")
        values = ", ".join(literal(c) for c in coefficients)
        body = f"const {name}: [f32; {len(coefficients)}] = [{values}];"
        print(body + "\n")
        constants.append((name, [literal(c) for c in coefficients]))

    # 2^f on [0, 1]; the first coefficient is 1 and all of them sum to 2.
    f = chebyshev_grid(0.0, 1.0)
    exp2, error = fit(f, np.exp2(f), np.exp2(f), 5, value_at=[(0.0, 1.0), (1.0, 2.0)])
    horner = np.float32(0)
    for c in exp2[::-1]:
        horner = np.float32(horner + np.float32(c))
    assert exp2[0] == 1.0 and (exp2 > 0).all(), exp2
    assert horner == np.float32(2.0), horner
    emit("EXP2", exp2, error, "2^f on [0, 1], relative")

    # log2((1 + s)/(1 - s)) = s P(s^2); the factor s makes log2 1 = 0. Nowhere
    # above 1/2 at the seam, where the next octave starts from -1/2.
    seam = (np.sqrt(2.0) - 1) / (np.sqrt(2.0) + 1)
    s = chebyshev_grid(1e-4, seam * (1 + 1e-7))
    ratio = (np.log1p(s) - np.log1p(-s)) / np.log(2.0) / s
    log2, error = fit(s**2, ratio, ratio, 2, upper_at=[(seam**2, 0.5 / seam - 1e-7)])
    assert (log2 > 0).all()
    emit("LOG2", log2, error, "log2((1+s)/(1-s))/s in s^2, relative")

    # tanh x = x + x z P(z), z = x^2; relative to tanh x.
    x = chebyshev_grid(1e-3, 0.55)
    tanh, error = fit(x**2, (np.tanh(x) / x - 1) / x**2, np.tanh(x) / x**3, TANH_DEGREE)
    emit("TANH", tanh, error, "(tanh x - x)/x^3 in x^2 for x <= 0.55, relative to tanh")

    # sin r = r + r z P(z) and cos r = 1 + z P(z) for |r| <= pi/4, with a margin
    # for the rounding of the range reduction.
    r = chebyshev_grid(1e-2, np.pi / 4 * (1 + 1e-6))
    sin, error = fit(r**2, (np.sin(r) / r - 1) / r**2, np.sin(r) / r**3, SIN_DEGREE)
    emit("SIN", sin, error, "(sin r - r)/r^3 in r^2, relative to sin")

    # sin x = x P(x^2) for a quarter of a turn on either side, good enough for a force.
    x = chebyshev_grid(1e-3, np.pi / 2)
    near, error = fit(x**2, np.sin(x) / x, 1 / x, NEAR_DEGREE)
    emit("NEAR", near, error, "sin x in x^2 up to pi/2, absolute")
    cos, error = fit(r**2, (np.cos(r) - 1) / r**2, 1 / r**2, COS_DEGREE)
    emit("COS", cos, error, "(cos r - 1)/r^2 in r^2, absolute in cos")

    emit("HALF_PI", split_half_pi(9, 3), 0.0, "pi/2 in parts of 9, 9 and 24 bits")

    if "--check" in sys.argv[1:]:
        source = SOURCE.read_text()
        missing = [(n, v) for n, values in constants for v in values if v.lstrip("-") not in source]
        if missing:
            sys.exit(f"{SOURCE.name} does not hold {missing}")


if __name__ == "__main__":
    main()
