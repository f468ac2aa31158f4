"""The same computed with numpy and scipy, from the equations."""

import numpy as np
import pytest
from conftest import R1, Doubles
from scipy import linalg, stats

import schuler


def model(config: schuler.FilterConfig) -> tuple[Doubles, Doubles]:
    """Φ and Q by Van Loan's matrix exponential."""
    a, w = config.accelerometer, config.gyro
    f = np.array(
        [
            [0.0, -config.gravity, 1.0, 0.0],
            [1.0 / config.radius_m, 0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0 / a.tau_s, 0.0],
            [0.0, 0.0, 0.0, -1.0 / w.tau_s],
        ]
    )
    q = np.diag([0.0, 0.0, 2.0 * a.sigma**2 / a.tau_s, 2.0 * w.sigma**2 / w.tau_s])
    both = linalg.expm(np.block([[-f, q], [np.zeros((4, 4)), f.T]]) * config.step_s)
    phi = both[4:, 4:].T
    return phi, phi @ both[:4, 4:]


def test_discretisation() -> None:
    for step_s in (1.0, 10.0, 66.0):
        config = schuler.FilterConfig(
            accelerometer=R1.accelerometer, gyro=R1.gyro, velocity_noise=0.1, step_s=step_s
        )
        filter_ = schuler.ErrorFilter(config)
        phi, q = model(config)
        np.testing.assert_allclose(filter_.transition, phi, rtol=1e-10, atol=1e-300)
        scale = np.sqrt(np.outer(q.diagonal(), q.diagonal()))
        np.testing.assert_allclose(filter_.process_noise / scale, q / scale, atol=1e-7)


def test_filter_is_the_kalman_filter() -> None:
    random = np.random.default_rng(7)
    filter_ = schuler.ErrorFilter(R1)
    phi, q = filter_.transition, filter_.process_noise
    z = np.cumsum(0.01 * random.standard_normal(3000))
    z[random.random(3000) < 0.1] = np.nan
    run = filter_.run(z)

    x = np.zeros(4)
    p = np.diag([0.1, 1e-4, R1.accelerometer.sigma, R1.gyro.sigma]) ** 2
    h = np.array([1.0, 0.0, 0.0, 0.0])
    for k, measured in enumerate(z):
        x, p = phi @ x, phi @ p @ phi.T + q
        s = p[0, 0] + R1.velocity_noise**2
        assert run.innovation_variance[k] == pytest.approx(s, rel=1e-8)
        if np.isfinite(measured):
            assert not run.gated[k]
            nu = measured - x[0]
            gain = p[:, 0] / s
            x = x + gain * nu
            joseph = np.eye(4) - np.outer(gain, h)
            p = joseph @ p @ joseph.T + R1.velocity_noise**2 * np.outer(gain, gain)
            assert run.innovation[k] == pytest.approx(nu, rel=1e-6, abs=1e-9)
            assert run.log_likelihood[k] == pytest.approx(-0.5 * (np.log(s) + nu**2 / s), rel=1e-8)
        else:
            assert np.isnan([run.innovation[k], run.nis[k], run.log_likelihood[k]]).all()
        sigma = np.sqrt(p.diagonal())
        np.testing.assert_allclose(run.sigma[k], sigma, rtol=1e-7)
        assert np.abs(run.estimate[k] - x).max() < 1e-6 or (np.abs(run.estimate[k] - x) < 1e-6 * sigma).all()
    np.testing.assert_allclose(filter_.mean, x, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(filter_.covariance, p, rtol=1e-6, atol=1e-20)


def test_isolation_from_linear_algebra() -> None:
    random = np.random.default_rng(11)
    sigma = np.array([1.0, 2.0, 1.5, 3.0, 1.0])
    block = schuler.GyroBlock(sigma=sigma)
    a = block.axes
    whitened_axes = a / sigma[:, None]
    v = linalg.null_space(whitened_axes.T).T
    rates = random.standard_normal((200, 5)) * sigma + random.standard_normal((200, 3)) @ a.T
    whitened = rates / sigma
    np.testing.assert_allclose(block.projector, v.T @ v, atol=1e-13)
    np.testing.assert_allclose((block.parity(rates) ** 2).sum(1), ((whitened @ v.T) ** 2).sum(1), rtol=1e-9)

    projection = block.project(rates)
    for k in range(5):
        # A fault of gyro k is one more column; least squares says how large it is and what it leaves.
        with_fault = np.column_stack([whitened_axes, np.eye(5)[k] / sigma[k]])
        solution = np.linalg.lstsq(with_fault, whitened.T, rcond=None)[0]
        np.testing.assert_allclose(projection.sizes[:, k], solution[3], rtol=1e-8, atol=1e-10)
        left = ((whitened.T - with_fault @ solution) ** 2).sum(0)
        np.testing.assert_allclose(projection.unexplained[:, k], left, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(projection.total - left, block.likelihood(rates)[:, k], rtol=1e-6, atol=1e-9)

        augmented = np.dstack([np.broadcast_to(a, (200, 5, 3)), rates[:, :, None]])
        determinant = np.linalg.det(np.delete(augmented, k, axis=1))
        np.testing.assert_allclose(np.abs(block.determinants(rates, normalised=False)[:, k]), np.abs(determinant), rtol=1e-8, atol=1e-12)

        least = sigma.min()
        for condition, fourth in (
            (block.condition_numbers(rates), whitened * least),
            (block.condition_numbers(rates, residual=True), whitened * least @ (v.T @ v)),
        ):
            columns = np.dstack([np.broadcast_to(whitened_axes * least, (200, 5, 3)), fourth[:, :, None]])
            np.testing.assert_allclose(condition[:, k], np.linalg.cond(np.delete(columns, k, axis=1)), rtol=1e-6)

        four = np.delete(np.arange(5), k)
        expected = np.linalg.lstsq(whitened_axes[four], whitened[:, four].T, rcond=None)[0].T
        np.testing.assert_allclose(block.rate(rates, without=k), expected, rtol=1e-8, atol=1e-10)
        covariance = np.linalg.inv(whitened_axes[four].T @ whitened_axes[four])
        np.testing.assert_allclose(block.rate_covariance(without=k), covariance, rtol=1e-8, atol=1e-12)

    sequential = block.sequential(rates)
    np.testing.assert_allclose(sequential.total, projection.total[:, None] * np.ones(5), rtol=1e-7)
    np.testing.assert_allclose(sequential.ratio.argmax(1), projection.unexplained.argmin(1))
    assert stats.kstest(projection.total, stats.chi2(2).cdf).pvalue > 1e-4


def test_autocorrelation_over_gaps() -> None:
    random = np.random.default_rng(13)
    x = random.standard_normal(500)
    x[random.random(500) < 0.2] = np.nan
    for remove_mean in (False, True):
        found = schuler.autocorrelation(x, 30, remove_mean=remove_mean)
        about = x - np.nanmean(x) if remove_mean else x
        for lag in range(31):
            products = about[lag:] * about[: len(x) - lag]
            assert found.pairs[lag] == np.isfinite(products).sum()
            assert found.covariance[lag] == pytest.approx(np.nanmean(products), abs=1e-12)


def test_allan_deviation() -> None:
    x = np.random.default_rng(17).standard_normal(2000)
    found = schuler.allan_deviation(x, 0.5)
    angle = np.concatenate([[0.0], np.cumsum(x)])
    for tau_s, deviation in zip(found.tau_s, found.deviation, strict=True):
        m = round(tau_s / 0.5)
        second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
        assert deviation == pytest.approx(np.sqrt(np.mean(second**2) / 2.0) / m, rel=1e-9)


def test_exact_correlations_give_their_parameters() -> None:
    t = 10.0 * np.arange(400)
    alpha, beta = 1.0 / 600.0, 2.0 * np.pi / 1800.0
    exponential = schuler.fit_exponential(4.0 * np.exp(-alpha * t), 10.0)
    assert exponential is not None
    assert exponential.alpha == pytest.approx(alpha, rel=1e-12) and exponential.variance == 4.0
    structure = schuler.choose_structure(np.exp(-alpha * t) * np.cos(beta * t), 10.0, 1e5)
    assert structure.kind == "exponential_cosine" and structure.exponential_cosine is not None
    # The crossing is found by a straight line between two lags.
    assert structure.exponential_cosine.beta == pytest.approx(beta, rel=1e-4)
    assert structure.exponential_cosine.alpha == pytest.approx(alpha, rel=1e-2)
    assert schuler.choose_structure(np.exp(-alpha * t), 10.0, 1e5).kind == "exponential"
    assert schuler.choose_structure(np.eye(1, 400)[0], 10.0, 1e5).kind == "none"
