# %% [markdown]
# # The papers' tables and figures, from Python
#
# Runs as a script (`python examples/papers.py [OUT]`) and cell by cell in an editor that knows `# %%`. Every table is compared
# with the published numbers, or with golden numbers where a paper has only pictures; figures go to `out/`.
#
# 1. Larin (2015), "On identification of faults of navigation measuring elements", Int. Appl. Mech. 51(6): both tables.
# 2. "Structural and parametric identification of error models of inertial sensors": the filter with wrong and with right
#    coefficients, identification by correlation, and in flight.

# %%
import sys
from pathlib import Path
from typing import Any

import matplotlib

if __name__ == "__main__":
    # No screen needed.
    matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

import schuler

Doubles = NDArray[np.float64]

OUT = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
OUT.mkdir(parents=True, exist_ok=True)


def compare(what: str, found: ArrayLike, golden: ArrayLike, relative: float = 1e-6, absolute: float = 0.0) -> None:
    """Compares with golden numbers, and says how far off the worst is."""
    found, golden = np.asarray(found), np.asarray(golden)
    np.testing.assert_allclose(found, golden, rtol=relative, atol=absolute, err_msg=what)
    print(f"{what}: {golden.size} numbers, worst difference {np.abs(found - golden).max():.1e}")


def save(figure: Any, name: str) -> None:
    """Saves a figure."""
    figure.savefig(OUT / f"{name}.png", dpi=150, bbox_inches="tight")
    plt.close(figure)
    print(f"wrote {OUT / name}.png")


# %% [markdown]
# ## Five gyros: Tables 1 and 2
#
# One noise vector reproduces both published tables: σ = 0.1 times the first five numbers of the classical uniform
# generator. Row i has a fault of one in gyro i.

# %%
u = np.array([0.950129285147175, 0.231138513574288, 0.606842583541787, 0.485982468709300, 0.891298966148902])
noise = 0.1 * np.sqrt(12.0) * (u - 0.5)
block = schuler.GyroBlock()

# Table 2: the five determinants.
TABLE_2 = [
    [0.0814, 0.6730, 1.0075, 0.9572, 0.5413],
    [0.4245, 0.1671, 0.6949, 0.9572, 0.8539],
    [0.7371, 0.3388, 0.1890, 0.6446, 0.8539],
    [0.8999, 0.9857, 0.6949, 0.1387, 0.4705],
    [0.5873, 0.9857, 1.0075, 0.6446, 0.0354],
]
# Table 1: the sequential filter. Its row i has the fault in gyro 6 - i.
TABLE_1 = [
    [0.2849, 0.0303, 0.3440, 1.4821, 367.6578],
    [0.0091, 0.2664, 1.1265, 24.3626, 0.6189],
    [0.6098, 3.5288, 5.7698, 0.0232, 0.1194],
    [2.8948, 10.2930, 0.0438, 0.0988, 0.5483],
    [58.3723, 0.1144, 0.0634, 0.4445, 2.0705],
]
# The same with the gain of the Kalman filter.
KALMAN = [
    [2.187242, 0.131542, 0.082933, 1.645912, 876.375768],
    [0.237128, 0.031318, 1.075036, 51.087913, 3.526409],
    [0.353468, 5.408498, 19.584406, 0.770035, 0.008498],
    [4.187324, 32.456869, 0.93542, 0.019975, 0.281668],
    [160.956535, 1.370245, 0.057575, 0.171684, 2.664405],
]

for rate in ([0.0, 0.0, 0.0], [1.0, -2.0, 3.0]):
    # The rate of the body changes nothing.
    rates = block.axes @ rate + noise + np.eye(5)
    determinants = np.abs(block.determinants(rates, normalised=False))
    # Four decimals: half a unit of the last.
    compare(f"Table 2, rate {rate}", determinants, TABLE_2, relative=0.0, absolute=5.1e-5)
    published = block.sequential(rates, recursion="covariance_first").ratio[::-1]
    compare(f"Table 1, rate {rate}", published, TABLE_1, relative=5.1e-5, absolute=5.1e-5)
    compare(f"the same by Kalman's gain, rate {rate}", block.sequential(rates).ratio[::-1], KALMAN, 1e-5, 1e-5)

# The condition numbers of the same matrices, in the place of the determinants; the paper prints none.
conditions = block.condition_numbers(noise + np.eye(5))
augmented = np.dstack([np.broadcast_to(block.axes, (5, 5, 3)), (noise + np.eye(5))[:, :, None]])
expected = np.stack([np.linalg.cond(np.delete(augmented, k, axis=1)) for k in range(5)], axis=1)
compare("condition numbers at rest", conditions, expected, 1e-9, 0.0)
assert (conditions.argmax(1) == np.arange(5)).all()

# Every method names the gyro that has failed, and they are one.
scaled = schuler.GyroBlock(sigma=np.full(5, 0.1))
projection = scaled.project(rates)
assert (determinants.argmin(1) == np.arange(5)).all()
assert (projection.unexplained.argmin(1) == np.arange(5)).all()
assert (scaled.sequential(rates).ratio.argmax(1) == np.arange(5)).all()
compare("T", projection.total, [57.975, 50.469, 39.712, 54.107, 59.365], relative=0.0, absolute=5e-4)
compare("size of the fault", projection.sizes.diagonal(), [1.2002, 1.1063, 0.9719, 1.1518, 1.2176], 0.0, 5.1e-5)

figure, panels = plt.subplots(1, 2, figsize=(9, 4))
for panel, values, title in (
    (panels[0], determinants, "Table 2: |determinant|, least names the gyro"),
    (panels[1], np.log10(published[::-1]), "Table 1: lg of the ratio, largest names the gyro"),
):
    image = panel.imshow(values, cmap="viridis")
    panel.set(title=title, xlabel="gyro tested", ylabel="gyro that has failed")
    panel.set_xticks(range(5), range(1, 6))
    panel.set_yticks(range(5), range(1, 6))
    figure.colorbar(image, ax=panel)
save(figure, "five_gyros")

# %% [markdown]
# ## How often one sample names the right gyro
#
# Against the theory for the cone (an integral over the sector of 36° about the gyro's line).


# %%
def theory(size: float) -> float:
    """P(correct) of the likelihood ratio, for a fault of so many σ."""
    mu = size * np.sqrt(0.4)
    angle = np.linspace(-np.pi / 10.0, np.pi / 10.0, 20_001)
    both = np.concatenate([angle, angle + np.pi])
    along = mu * np.cos(both)
    density = np.exp(-(mu**2) / 2.0) / (2.0 * np.pi)
    density = density + along * norm.cdf(along) * np.exp(-((mu * np.sin(both)) ** 2) / 2.0) / np.sqrt(2.0 * np.pi)
    return float(np.trapezoid(density[:20_001], angle) + np.trapezoid(density[20_001:], angle))


sizes = np.array([2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0])
optimum = np.array([theory(size) for size in sizes])
compare("theory", optimum, [0.3291, 0.4480, 0.5666, 0.7591, 0.8821, 0.9493, 0.9810, 0.9966, 0.9999], 0.0, 5.1e-5)
random = np.random.default_rng(20151106)
trials = 100_000
found = []
for size in sizes:
    samples = random.standard_normal((trials, 5))
    samples[:, 0] += size
    found.append(float((block.likelihood(samples).argmax(1) == 0).mean()))
# Five standard deviations of what so many trials can say.
np.testing.assert_array_less(np.abs(found - optimum), 5.0 * np.sqrt(optimum * (1.0 - optimum) / trials) + 1e-5)
figure, panel = plt.subplots(figsize=(6, 4))
panel.plot(sizes, optimum, label="theory")
panel.plot(sizes, found, "o", label=f"{trials} samples")
panel.set(xlabel="size of the fault, σ", ylabel="P(right gyro)")
panel.legend()
save(figure, "right_gyro")

# %% [markdown]
# ## The error filter: right and wrong coefficients
#
# Record K1: six hours of the loop with an accelerometer error of 10⁻⁴ g (τ = 60 s) and a gyro drift of 0.1 °/h (τ = 1800 s),
# and r = 0.1 m/s. Generator: s ← 16807 s mod 2³¹ − 1, normals in pairs by Box and Muller.

# %%
HOUR_ANGLE = np.pi / 180.0 / 3600.0
ARC_SECOND = HOUR_ANGLE
SIGMA_A, TAU_A, SIGMA_W, TAU_W = 9.80665e-4, 60.0, 0.1 * HOUR_ANGLE, 1800.0


def normals(seed: int, count: int) -> Doubles:
    """Standard normals of the minimal-standard generator."""
    state, uniform = seed, np.empty(count + count % 2)
    for k in range(uniform.size):
        state = 16807 * state % 2147483647
        uniform[k] = state / 2147483647
    radius = np.sqrt(-2.0 * np.log(uniform[::2]))
    angle = 2.0 * np.pi * uniform[1::2]
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]).ravel()[:count]


def config(rates: float = 1.0, diffusions: float = 1.0, gate_sigma: float = 1e9) -> schuler.FilterConfig:
    """R1 with rates 1/τ and diffusions σ√(2/τ) multiplied."""
    factor = diffusions / np.sqrt(rates)
    return schuler.FilterConfig(
        accelerometer=schuler.MarkovNoise(SIGMA_A * factor, TAU_A / rates),
        gyro=schuler.MarkovNoise(SIGMA_W * factor, TAU_W / rates),
        velocity_noise=0.1,
        gate_sigma=gate_sigma,
    )


def golden_filter(about: schuler.FilterConfig) -> schuler.ErrorFilter:
    """A filter with the discretisation of the golden numbers."""
    return schuler.ErrorFilter(about, discretisation="third_order")


STEPS = 21_600
draws = normals(20261120, 4 + 3 * STEPS)
truth_filter = golden_filter(config())
driving = np.sqrt(truth_filter.process_noise.diagonal())
x = np.array([0.1, 1e-4, SIGMA_A, SIGMA_W]) * draws[:4]
truth, measured = np.empty((STEPS, 4)), np.empty(STEPS)
for k, (accelerometer, gyro, velocity) in enumerate(draws[4:].reshape(-1, 3)):
    x = truth_filter.transition @ x
    x[2] += driving[2] * accelerometer
    x[3] += driving[3] * gyro
    truth[k] = x
    measured[k] = x[0] + 0.1 * velocity
compare("record K1, start", measured[:5], [-0.009924023, 0.083134697, 0.043607948, 0.177473599, -0.010746510], 0.0, 1e-9)
compare("record K1, end", truth[-1], [-9.799552462, 2.796664847e-3, -7.367754e-4, -1.233820e-7])

GOLDEN = {
    "true": (config(), 38468.53320, [7.197764e-5, 8.858363e-4, 2.738028e-7], [1.036551, 0.011481, 15.115349]),
    "low": (config(0.1, 0.1), 37201.55404, [3.169292e-5, 2.935779e-4, 4.510743e-8], [13.586552, 0.432778, 24.095864]),
    "high": (config(10.0, 0.1), -6468.38261, [3.830369e-6, 3.101123e-5, 1.515854e-8], [1718.4336, 0.916667, 32.751569]),
}
runs = {}
for name, (about, log_likelihood, sigma, consistency) in GOLDEN.items():
    run = golden_filter(about).run(measured)
    runs[name] = run
    late = slice(STEPS // 4, None)
    error = run.estimate[late, 1] - truth[late, 1]
    nees = (error / run.sigma[late, 1]) ** 2
    compare(f"{name}: log-likelihood", run.log_likelihood.sum(), log_likelihood)
    compare(f"{name}: standard deviations at the end", run.sigma[-1, 1:], sigma)
    measures = [nees.mean(), (nees > 9.0).mean(), np.sqrt((error**2).mean()) / ARC_SECOND]
    compare(f"{name}: NEES, beyond 3σ, RMSE in arc seconds", measures, consistency, 1e-6, 1e-6)

hours = np.arange(STEPS) / 3600.0
figure, panels = plt.subplots(2, 1, figsize=(9, 6), sharex=True)
for panel, name, title in (
    (panels[0], "low", "drift and diffusion coefficients off by ten"),
    (panels[1], "true", "coefficients as required"),
):
    run = runs[name]
    panel.plot(hours, (run.estimate[:, 1] - truth[:, 1]) / ARC_SECOND, linewidth=0.6, label="error of δ")
    for sign in (3.0, -3.0):
        panel.plot(hours, sign * run.sigma[:, 1] / ARC_SECOND, "k--", linewidth=0.8, label="±3σ" if sign > 0 else None)
    panel.set(title=title, ylabel="arc seconds")
    panel.legend(loc="upper right")
panels[1].set_xlabel("time, h")
save(figure, "right_and_wrong_coefficients")

# %% [markdown]
# ## Identification by correlation
#
# Equations (11), (13), (15) on the filter's own estimates, with what the estimate's variance is short of added (C1).

# %%
run = runs["true"]
every_ten = slice(600, None, 10)
for state, name, golden_lags, tau, lags, sigma_c1 in (
    (2, "accelerometer", {0: 1.788081957e-7, 1: 1.528309634e-7, 5: 8.270565e-8, 10: 4.801640e-8}, 63.938761, 4, 9.816458e-4),
    (3, "gyro", {0: 2.159438639e-13, 1: 2.151817344e-13}, 1865.18265, 110, 5.393809e-7),
):
    found_r = schuler.autocorrelation(run.estimate[every_ten, state], 180).covariance
    compare(f"{name}: R", found_r[list(golden_lags)], list(golden_lags.values()))
    fit = schuler.fit_exponential(found_r, 10.0)
    assert fit is not None and fit.lags == lags
    compare(f"{name}: τ", 1.0 / fit.alpha, tau)
    mean_variance = (run.sigma[every_ten, state] ** 2).mean()
    compare(f"{name}: σ with C1", np.sqrt(fit.variance + mean_variance), sigma_c1)

# An exponential-cosine series: α = 1/600, β = 2π/1800, Δ = 10 s.
alpha, beta, spacing_s, count = 1.0 / 600.0, 2.0 * np.pi / 1800.0, 10.0, 4096
draws = normals(54321, 2 + 2 * count)
decay, turn = np.exp(-alpha * spacing_s), beta * spacing_s
rotation = decay * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
pair, series = draws[:2], np.empty(count)
for k, driven in enumerate(draws[2:].reshape(-1, 2)):
    pair = rotation @ pair + np.sqrt(1.0 - decay**2) * driven
    series[k] = pair[0]
compare("exponential-cosine series", series[:3], [-0.3136693777, -0.1618400895, -0.3761139910], 1e-9)
correlation = schuler.autocorrelation(series, 400).covariance
compare("its R", correlation[[0, 1, 20]], [0.9559107138, 0.938122808, 0.5211547672], 1e-8)
structure = schuler.choose_structure(correlation, spacing_s, count * spacing_s)
assert structure.kind == "exponential_cosine"
cosine, exponential = structure.exponential_cosine, structure.exponential
assert cosine is not None and exponential is not None and cosine.crossing_lag == 46 and cosine.lags == 36
compare("its τ_β, β, α", [cosine.crossing_s, cosine.beta, cosine.alpha], [457.4531458, 0.00343378626, 0.00180802782], 1e-7)
misfits = [structure.exponential_misfit, structure.exponential_cosine_misfit, structure.depth]
compare("misfits and depth", np.array(misfits, dtype=float), [0.04734018, 0.00193256, 2.3511], 5e-5)

lag_s = spacing_s * np.arange(correlation.size)
figure, panel = plt.subplots(figsize=(7, 4))
panel.plot(lag_s, correlation / correlation[0], label="normalised correlation")
panel.plot(lag_s, np.exp(-exponential.alpha * lag_s), "--", label="exponential")
panel.plot(lag_s, np.exp(-cosine.alpha * lag_s) * np.cos(cosine.beta * lag_s), label="exponential-cosine")
panel.axhline(0.0, color="grey", linewidth=0.5)
panel.set(xlabel="lag, s", ylabel="R(t)/R(0)")
panel.legend()
save(figure, "normalised_correlation")

# %% [markdown]
# ## In flight
#
# The same record through the module as it flies, from a data sheet that is wrong by ten: the bank of filters bridges the time
# until the first identification, and then the filter is retuned.

# %%
flight = schuler.AdaptiveFilter(config(0.1, 0.1, gate_sigma=6.0)).run(measured)
retuned = flight.retuned.nonzero()[0]
assert retuned.size >= 1
late = slice(int(retuned[0]), None)
error = flight.averaged[late, 1] - truth[late, 1]
nees_flight = float(((error / flight.averaged_sigma[late, 1]) ** 2).mean())
error_low = runs["low"].estimate[late, 1] - truth[late, 1]
nees_low = float(((error_low / runs["low"].sigma[late, 1]) ** 2).mean())
print(f"after the first retuning: NEES {nees_flight:.2f}, without it {nees_low:.2f}; one is right")
assert nees_flight < 3.0 < nees_low

figure, panels = plt.subplots(2, 1, figsize=(9, 6), sharex=True)
panels[0].plot(hours, (flight.averaged[:, 1] - truth[:, 1]) / ARC_SECOND, linewidth=0.6, label="error of δ")
for sign in (3.0, -3.0):
    panels[0].plot(hours, sign * flight.averaged_sigma[:, 1] / ARC_SECOND, "k--", linewidth=0.8)
panels[0].set(ylabel="arc seconds", title="error of the vertical and ±3σ, retuned in flight")
panels[1].semilogy(hours, flight.accelerometer_noise[:, 0] / SIGMA_A, label="σ of the accelerometer over the truth")
panels[1].semilogy(hours, flight.gyro_noise[:, 0] / SIGMA_W, label="σ of the gyro over the truth")
panels[1].axhline(1.0, color="grey", linewidth=0.5)
panels[1].set(xlabel="time, h")
panels[1].legend()
save(figure, "retuned_in_flight")
print("everything is as published")
