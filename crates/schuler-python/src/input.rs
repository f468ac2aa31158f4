//! Arrays that come from Python, and arrays that go there.
use numpy::ndarray::Dimension;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};
use schuler_core::config::ConfigError;

/// Lists within each other that an array-like may have.
const DEEPEST: usize = 8;

/// The numbers of an array-like of one dimension; NaN where a masked array is masked.
///
/// # Errors
/// `ValueError` with the name of the argument, what was found and what was expected.
pub(crate) fn vector(name: &str, values: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    numbers(name, values, "(n,)", |shape| matches!(shape, [_]))
}

/// The rows of an array-like of shape (n, `N`).
///
/// # Errors
/// As [`vector`].
pub(crate) fn rows<const N: usize>(name: &str, values: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; N]>> {
    let flat =
        numbers(name, values, &format!("(n, {N})"), |shape| matches!(shape, [_, columns] if *columns == N))?;
    Ok(flat.as_chunks::<N>().0.to_vec())
}

/// An array-like of exactly `N` numbers.
///
/// # Errors
/// As [`vector`].
pub(crate) fn exactly<const N: usize>(name: &str, values: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let flat = numbers(name, values, &format!("({N},)"), |shape| matches!(shape, [length] if *length == N))?;
    flat.try_into().map_err(|_| wrong(format!("{name}: expected {N} numbers")))
}

/// Whether lists lie more than [`DEEPEST`] times within each other. numpy goes through all that they hold before it refuses
/// them, and lists that are held twice by lists that are held twice, and so on, hold more than there is memory for.
fn is_deep(values: &Bound<'_, PyAny>) -> PyResult<bool> {
    let mut inner = values.clone();
    for _ in 0..DEEPEST {
        if !(inner.is_instance_of::<PyList>() || inner.is_instance_of::<PyTuple>()) {
            return Ok(false);
        }
        let Some(first) = inner.try_iter()?.next() else { return Ok(false) };
        inner = first?;
    }
    Ok(true)
}

/// The numbers of an array-like whose shape is `fitting`, row by row.
fn numbers(
    name: &str,
    values: &Bound<'_, PyAny>,
    expected: &str,
    fitting: impl Fn(&[usize]) -> bool,
) -> PyResult<Vec<f64>> {
    let py = values.py();
    if is_deep(values)? {
        let found = format!("{name}: found lists within lists more than {DEEPEST} times");
        return Err(wrong(format!("{found}; expected numbers of shape {expected}")));
    }
    let numpy = py.import("numpy")?;
    let array = numpy.call_method1("asanyarray", (values,)).map_err(|error| {
        wrong(format!("{name}: {}; expected numbers of shape {expected}", error.value(py)))
    })?;
    let untyped = array.cast::<PyUntypedArray>()?;
    let kind: char = untyped.dtype().getattr("kind")?.extract()?;
    if !matches!(kind, 'b' | 'i' | 'u' | 'f') {
        let found = untyped.dtype().str()?;
        return Err(wrong(format!("{name}: found values of type {found}; expected real numbers")));
    }
    if !fitting(untyped.shape()) {
        let found = array.getattr("shape")?.str()?;
        return Err(wrong(format!("{name}: found an array of shape {found}; expected {expected}")));
    }
    let masked = numpy.getattr("ma")?;
    let array = if array.is_instance(&masked.getattr("MaskedArray")?)? {
        masked.call_method1("filled", (array.call_method1("astype", ("f8",))?, f64::NAN))?
    } else {
        array
    };
    // `ascontiguousarray` leaves an array that is not aligned as it is.
    let array = numpy.call_method1("require", (array, "f8", ["C", "A", "E"]))?;
    Ok(array.cast::<PyArrayDyn<f64>>()?.readonly().as_slice()?.to_vec())
}

/// The array of these numbers.
pub(crate) fn array1<T: Element>(py: Python<'_>, values: Vec<T>) -> Py<PyArray1<T>> {
    values.into_pyarray(py).unbind()
}

/// The array with these rows.
///
/// # Errors
/// Never: every row has `N` numbers.
pub(crate) fn array2<T: Element, const N: usize>(
    py: Python<'_>,
    rows: Vec<[T; N]>,
) -> PyResult<Py<PyArray2<T>>> {
    let shape = [rows.len(), N];
    Ok(rows.into_flattened().into_pyarray(py).reshape(numpy::ndarray::Dim(shape).into_pattern())?.unbind())
}

/// The exception for an argument that cannot be used.
pub(crate) fn wrong(message: impl Into<String>) -> PyErr {
    PyValueError::new_err(message.into())
}

/// The same for a configuration.
pub(crate) fn misconfigured(error: ConfigError) -> PyErr {
    wrong(error.to_string())
}
