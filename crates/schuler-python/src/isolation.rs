//! Five gyros.
use host_sim::compare_isolation::condition::condition_numbers;
use nalgebra::{SVector, Vector3};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::{GYROS, ParitySpace};
use schuler_core::isolation::projector::OrthogonalProjector;
use schuler_core::isolation::rate::RateEstimator;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use schuler_core::isolation::{self as core, IsolationConfig, IsolationOutput, Verdict};
use schuler_core::reading::Reading;

use crate::input::{array1, array2, exactly, misconfigured, rows, wrong};

/// Five rates or five numbers about them.
type Five = [f64; GYROS];

/// What the projector says of each sample.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct Projection {
    /// ‖G y‖² in σ²: chi-square with two degrees of freedom without a fault; shape (n,).
    total: Py<PyArray1<f64>>,
    /// What a fault of gyro k leaves unexplained, in σ²: the least names the gyro; shape (n, 5).
    unexplained: Py<PyArray2<f64>>,
    /// How large the fault is if it is gyro k's, rad/s; shape (n, 5).
    sizes: Py<PyArray2<f64>>,
}

/// What the sequential filter says of each sample, with each gyro in turn processed last.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct SequentialStatistics {
    /// Last over previous, at most 1e12: the largest names the gyro; shape (n, 5).
    ratio: Py<PyArray2<f64>>,
    /// Normalised innovation squared of the gyro that came last; shape (n, 5).
    last: Py<PyArray2<f64>>,
    /// Of the one before; shape (n, 5).
    previous: Py<PyArray2<f64>>,
    /// Sum of both; shape (n, 5).
    total: Py<PyArray2<f64>>,
}

/// A block of five gyros and the paper's ways of finding the one that has failed, sample by sample.
///
/// axes: unit input axes in body axes, one row a gyro, shape (5, 3); without them the symmetric cone. sigma: 1-σ noise
/// of each gyro, rad/s, shape (5,); without it 1. rates everywhere: rad/s along the input axes, shape (n, 5); a row with
/// NaN gives NaN.
#[pyclass(module = "schuler", frozen)]
pub(crate) struct GyroBlock {
    axes: [Five; 3],
    sigma: Five,
    space: ParitySpace<f64>,
    /// Of the axes as they are.
    raw: FiveDeterminants<f64>,
    normalised: FiveDeterminants<f64>,
    projector: OrthogonalProjector<f64, GYROS>,
    estimator: RateEstimator<f64>,
}

#[pymethods]
impl GyroBlock {
    #[new]
    #[pyo3(signature = (axes=None, sigma=None))]
    fn new(axes: Option<&Bound<'_, PyAny>>, sigma: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let (axes, sigma) = (axes_of(axes)?, sigma_of(sigma)?.unwrap_or([1.0; GYROS]));
        let space = ParitySpace::try_build(&axes, &sigma).map_err(misconfigured)?;
        let projector = OrthogonalProjector::new(space.geometry());
        Ok(Self {
            axes: std::array::from_fn(|axis| axes.map(|gyro| gyro[axis])),
            sigma,
            raw: FiveDeterminants::new(&axes.map(Vector3::from)),
            normalised: FiveDeterminants::normalised(&space),
            projector,
            estimator: RateEstimator::new(&space),
            space,
        })
    }

    /// What pickle and copy make it anew from.
    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (self.axes(py)?, self.sigma(py)).into_pyobject(py)
    }

    /// Unit input axes, one row a gyro; shape (5, 3).
    #[getter]
    fn axes(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        array2(py, (0..GYROS).map(|gyro| self.axes.map(|axis| axis[gyro])).collect())
    }

    /// 1-σ noise of each gyro, rad/s; shape (5,).
    #[getter]
    fn sigma(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        array1(py, self.sigma.to_vec())
    }

    /// The parity matrix V of the whitened axes, V A = 0 and V Vᵀ = I; shape (2, 5).
    #[getter]
    fn parity_matrix(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        array2(
            py,
            self.space
                .matrix()
                .row_iter()
                .map(|row| std::array::from_fn::<_, GYROS, _>(|k| row[k]))
                .collect(),
        )
    }

    /// The projector G = VᵀV; shape (5, 5).
    #[getter]
    fn projector(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let projector = self.space.geometry().projector();
        array2(py, projector.row_iter().map(|row| std::array::from_fn::<_, GYROS, _>(|k| row[k])).collect())
    }

    /// √det(AᵀA) of the whitened axes.
    #[getter]
    fn volume(&self) -> f64 {
        self.space.geometry().volume()
    }

    /// The parity vector of each sample, in σ; shape (n, 2).
    fn parity(&self, py: Python<'_>, rates: &Bound<'_, PyAny>) -> PyResult<Py<PyArray2<f64>>> {
        let rates = rows("rates", rates)?;
        let parity =
            py.detach(|| rates.iter().map(|y| self.space.parity(&self.whitened(y)).into()).collect());
        array2::<f64, 2>(py, parity)
    }

    /// The five determinants of each sample, shape (n, 5); number j does not contain reading j, and the least in magnitude
    /// names the gyro. normalised: in σ and of unit variance for any geometry; otherwise those of [A y], rad/s.
    #[pyo3(signature = (rates, *, normalised=true))]
    fn determinants(
        &self,
        py: Python<'_>,
        rates: &Bound<'_, PyAny>,
        normalised: bool,
    ) -> PyResult<Py<PyArray2<f64>>> {
        let rates = rows("rates", rates)?;
        let of = |y: &Five| {
            if normalised { self.normalised.of(&self.whitened(y)) } else { self.raw.of(&SVector::from(*y)) }
        };
        let found = py.detach(|| rates.iter().map(|y| of(y).into()).collect());
        array2::<f64, GYROS>(py, found)
    }

    /// The condition number of [A y] without row j, shape (n, 5); the largest names the gyro. The paper's alternative to the
    /// determinants: it depends on the unit of the rates and on the rate of the body. residual: of [A Gy], which does not
    /// contain the rate. Axes and rates are weighed by the least sigma over each gyro's own.
    #[pyo3(signature = (rates, *, residual=false))]
    fn condition_numbers(
        &self,
        py: Python<'_>,
        rates: &Bound<'_, PyAny>,
        residual: bool,
    ) -> PyResult<Py<PyArray2<f64>>> {
        let rates = rows::<GYROS>("rates", rates)?;
        let geometry = self.space.geometry();
        let (axes, projector) = (geometry.matrix(), geometry.projector());
        let of = |y: &Five| -> Five {
            if y.iter().any(|rate| rate.is_nan()) {
                return [f64::NAN; GYROS];
            }
            let weighed = self.whitened(y) * geometry.reference_sigma();
            condition_numbers(&axes, &if residual { projector * weighed } else { weighed }).into()
        };
        let found = py.detach(|| rates.iter().map(of).collect());
        array2::<f64, GYROS>(py, found)
    }

    /// The likelihood statistic q of each gyro in each sample, in σ²; shape (n, 5). The largest names the gyro.
    fn likelihood(&self, py: Python<'_>, rates: &Bound<'_, PyAny>) -> PyResult<Py<PyArray2<f64>>> {
        let rates = rows("rates", rates)?;
        let of = |y: &Five| self.space.likelihood(&self.space.parity(&self.whitened(y)), 1.0);
        let found = py.detach(|| rates.iter().map(of).collect());
        array2::<f64, GYROS>(py, found)
    }

    /// The projection of each sample onto what no rate can produce.
    fn project(&self, py: Python<'_>, rates: &Bound<'_, PyAny>) -> PyResult<Projection> {
        let rates = rows("rates", rates)?;
        let found: Vec<_> =
            py.detach(|| rates.iter().map(|y| self.projector.project(&self.whitened(y))).collect());
        let sizes =
            |sizes: SVector<f64, GYROS>| -> Five { sizes.component_mul(&SVector::from(self.sigma)).into() };
        Ok(Projection {
            total: array1(py, found.iter().map(|it| it.total).collect()),
            unexplained: array2::<f64, GYROS>(py, found.iter().map(|it| it.unexplained.into()).collect())?,
            sizes: array2(py, found.iter().map(|it| sizes(it.sizes)).collect())?,
        })
    }

    /// The statistics of the sequential least-squares filter for each sample. recursion: "kalman", or "covariance_first" as
    /// the published table has it.
    #[pyo3(signature = (rates, *, recursion="kalman"))]
    fn sequential(
        &self,
        py: Python<'_>,
        rates: &Bound<'_, PyAny>,
        recursion: &str,
    ) -> PyResult<SequentialStatistics> {
        let recursion = match recursion {
            "kalman" => Recursion::Kalman,
            "covariance_first" => Recursion::CovarianceFirst,
            other => {
                let expected = "expected \"kalman\" or \"covariance_first\"";
                return Err(wrong(format!("recursion: found {other:?}; {expected}")));
            }
        };
        let filter = SequentialFilter::new(self.space.geometry(), recursion);
        let rates = rows::<GYROS>("rates", rates)?;
        let found: Vec<_> = py.detach(|| {
            let of = |y: &Five| {
                let whitened = self.whitened(y);
                std::array::from_fn::<_, GYROS, _>(|gyro| filter.statistics(gyro, &whitened))
            };
            rates.iter().map(of).collect()
        });
        let every =
            |pick: fn(&_) -> f64| array2(py, found.iter().map(|it| it.each_ref().map(pick)).collect());
        Ok(SequentialStatistics {
            // A missing reading is not a large ratio.
            ratio: every(
                |it: &core::sequential::InnovationStatistics<f64>| {
                    if it.total.is_nan() { f64::NAN } else { it.last_ratio() }
                },
            )?,
            last: every(|it| it.last)?,
            previous: every(|it| it.previous)?,
            total: every(|it| it.total)?,
        })
    }

    /// The rate of the body from all five gyros, or from the four without gyro `without`, rad/s; shape (n, 3).
    #[pyo3(signature = (rates, *, without=None))]
    fn rate(
        &self,
        py: Python<'_>,
        rates: &Bound<'_, PyAny>,
        without: Option<usize>,
    ) -> PyResult<Py<PyArray2<f64>>> {
        let without = gyro_of("without", without)?;
        let rates = rows("rates", rates)?;
        let of = |y: &Five| -> [f64; 3] {
            let mut whitened = self.whitened(y);
            if let Some(gyro) = without {
                // Also where its reading is missing.
                whitened[gyro] = 0.0;
            }
            self.estimator.rate(&self.space, &whitened, without).into()
        };
        let found = py.detach(|| rates.iter().map(of).collect());
        array2(py, found)
    }

    /// The covariance of that rate, (rad/s)²; shape (3, 3).
    #[pyo3(signature = (*, without=None))]
    fn rate_covariance(&self, py: Python<'_>, without: Option<usize>) -> PyResult<Py<PyArray2<f64>>> {
        let covariance = self.estimator.covariance(&self.space, gyro_of("without", without)?);
        array2(py, covariance.row_iter().map(|row| std::array::from_fn::<_, 3, _>(|k| row[k])).collect())
    }
}

impl GyroBlock {
    fn whitened(&self, rates: &Five) -> SVector<f64, GYROS> {
        SVector::from(*rates).component_div(&SVector::from(self.sigma))
    }
}

/// What the isolation says of each sample.
#[pyclass(module = "schuler", frozen, get_all)]
pub(crate) struct IsolationRun {
    /// Numbers of Verdict; shape (n,).
    verdict: Py<PyArray1<u8>>,
    /// The gyro that has failed where the verdict is FAULT, from 0, otherwise −1; shape (n,).
    faulty: Py<PyArray1<i8>>,
    /// Bits of IsolationFlags; shape (n,).
    flags: Py<PyArray1<u16>>,
    /// Gyros declared faulty, one bit a gyro; shape (n,).
    excluded: Py<PyArray1<u8>>,
    /// Rate of the body from the gyros in use, rad/s, NaN where there is none; shape (n, 3).
    rate: Py<PyArray2<f64>>,
    /// Its standard deviations, rad/s; shape (n, 3).
    rate_sigma: Py<PyArray2<f64>>,
    /// Parity vector, in σ, zero unless all five could be read; shape (n, 2).
    parity: Py<PyArray2<f64>>,
    /// Normalised determinants, in σ; shape (n, 5).
    determinants: Py<PyArray2<f64>>,
    /// The detection statistic nearest to its threshold, over the threshold; shape (n,).
    alarm_level: Py<PyArray1<f64>>,
    /// Lead of the likeliest gyro over the next; shape (n,).
    margin: Py<PyArray1<f64>>,
    /// Size of the excluded gyro's fault, rad/s, NaN while there is none; shape (n,).
    fault_size: Py<PyArray1<f64>>,
    /// Its standard deviation, rad/s; shape (n,).
    fault_sigma: Py<PyArray1<f64>>,
}

/// The isolation that flies: detection at a stated rate of false alarms, then which gyro, then the rate from the others.
///
/// axes: unit input axes, shape (5, 3); without them the symmetric cone. sigma: 1-σ noise of each gyro, rad/s, shape
/// (5,); without it 1e-7. range, offset, offset_limit, rate_limit: rad/s. false_alarm_interval, persistence and what
/// ends in _samples: samples. margin: lead of the likeliest gyro. relative_error: of scale and alignment.
#[pyclass(module = "schuler")]
#[derive(Clone)]
pub(crate) struct FaultIsolation {
    inner: core::FaultIsolation,
}

#[pymethods]
impl FaultIsolation {
    #[new]
    #[pyo3(signature = (axes=None, sigma=None, *, range=1.0, offset=None, calibration_samples=0, offset_limit=1e-6,
        false_alarm_interval=1e5, margin=9.2, persistence=3, give_up_samples=2000, relative_error=1e-5,
        rate_limit=2e-4, stuck_samples=10, lost_samples=60, readmit_samples=3600))]
    #[expect(clippy::too_many_arguments, reason = "named in Python")]
    fn new(
        axes: Option<&Bound<'_, PyAny>>,
        sigma: Option<&Bound<'_, PyAny>>,
        range: f64,
        offset: Option<&Bound<'_, PyAny>>,
        calibration_samples: u32,
        offset_limit: f64,
        false_alarm_interval: f64,
        margin: f64,
        persistence: u32,
        give_up_samples: u32,
        relative_error: f64,
        rate_limit: f64,
        stuck_samples: u32,
        lost_samples: u32,
        readmit_samples: u32,
    ) -> PyResult<Self> {
        let config = IsolationConfig {
            axes: axes_of(axes)?,
            sigma: sigma_of(sigma)?.unwrap_or(IsolationConfig::CONE.sigma),
            range,
            offset: offset.map(|it| exactly("offset", it)).transpose()?.unwrap_or_default(),
            calibration_samples,
            offset_limit,
            false_alarm_interval,
            margin,
            persistence,
            give_up_samples,
            relative_error,
            rate_limit,
            stuck_samples,
            lost_samples,
            readmit_samples,
        };
        let inner = core::FaultIsolation::try_build(&config).map_err(misconfigured)?;
        Ok(Self { inner })
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone()
    }

    /// Take as many samples as there are rows; the state goes on from where it was.
    ///
    /// rates: rad/s along the input axes, shape (n, 5); NaN is a missing reading. readmit: gyro to take back before the
    /// first sample.
    #[pyo3(signature = (rates, *, readmit=None))]
    fn run(
        &mut self,
        py: Python<'_>,
        rates: &Bound<'_, PyAny>,
        readmit: Option<usize>,
    ) -> PyResult<IsolationRun> {
        let mut readmit = gyro_of("readmit", readmit)?.map(|gyro| gyro as u8);
        let rates = rows::<GYROS>("rates", rates)?;
        let found: Vec<IsolationOutput> = py.detach(|| {
            rates.iter().map(|y| self.inner.step(&y.map(Reading::good), readmit.take())).collect()
        });
        let there = |condition: bool, value: f64| if condition { value } else { f64::NAN };
        Ok(IsolationRun {
            verdict: array1(py, found.iter().map(|it| code(it.verdict).0).collect()),
            faulty: array1(py, found.iter().map(|it| code(it.verdict).1).collect()),
            flags: array1(py, found.iter().map(|it| it.flags.bits()).collect()),
            excluded: array1(py, found.iter().map(|it| it.excluded).collect()),
            rate: array2(py, found.iter().map(|it| it.rate.map(|x| there(it.gyros_used != 0, x))).collect())?,
            rate_sigma: array2(
                py,
                found.iter().map(|it| it.rate_sigma.map(|x| there(it.gyros_used != 0, x))).collect(),
            )?,
            parity: array2(py, found.iter().map(|it| it.parity).collect())?,
            determinants: array2(py, found.iter().map(|it| it.determinants).collect())?,
            alarm_level: array1(py, found.iter().map(|it| it.alarm_level).collect()),
            margin: array1(py, found.iter().map(|it| it.margin).collect()),
            fault_size: array1(
                py,
                found.iter().map(|it| there(it.fault_sigma > 0.0, it.fault_size)).collect(),
            ),
            fault_sigma: array1(
                py,
                found.iter().map(|it| there(it.fault_sigma > 0.0, it.fault_sigma)).collect(),
            ),
        })
    }
}

/// The number of `schuler.Verdict`, and the gyro that has failed or −1.
fn code(verdict: Verdict) -> (u8, i8) {
    match verdict {
        Verdict::NoFault => (0, -1),
        Verdict::DetectedNotIsolated => (1, -1),
        Verdict::Fault(gyro) => (2, gyro.cast_signed()),
        Verdict::BlockUntrusted => (3, -1),
    }
}

/// Unit input axes, one row a gyro; those of the cone unless others are given.
fn axes_of(axes: Option<&Bound<'_, PyAny>>) -> PyResult<[[f64; 3]; GYROS]> {
    let Some(axes) = axes else { return Ok(IsolationConfig::CONE.axes) };
    let rows = rows::<3>("axes", axes)?;
    let found = rows.len();
    rows.try_into().map_err(|_| wrong(format!("axes: found {found} rows; expected {GYROS}")))
}

fn sigma_of(sigma: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Five>> {
    sigma.map(|sigma| exactly("sigma", sigma)).transpose()
}

fn gyro_of(name: &str, gyro: Option<usize>) -> PyResult<Option<usize>> {
    match gyro {
        Some(gyro) if gyro >= GYROS => Err(wrong(format!("{name}: found {gyro}; expected a gyro, 0 to 4"))),
        gyro => Ok(gyro),
    }
}
