//! NumPy arrays as the passes of a frame, where they lie; results as NumPy arrays.

use ndarray::{Array3, ArrayView, ArrayViewMut3, Axis, Dimension, Ix2, Ix3, s};
use numpy::prelude::*;
use numpy::{BorrowError, IxDyn, PyArray3, PyArrayDyn, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArray, dtype};
use pyo3::exceptions::{PyTypeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::errors::HushError;
use super::settings::check_lam;
use crate::engine::Denoised;
use crate::frame::{FrameView, LambdaMap, OwnedDial};

/// The arguments that are arrays, as Python gives them.
pub struct Given<'a, 'py> {
    pub color: &'a Bound<'py, PyAny>,
    pub albedo: Option<&'a Bound<'py, PyAny>>,
    pub normal: Option<&'a Bound<'py, PyAny>>,
    pub depth: Option<&'a Bound<'py, PyAny>>,
    pub vector: Option<&'a Bound<'py, PyAny>>,
    pub aovs: Option<&'a Bound<'py, PyDict>>,
}

/// The passes of a frame, checked; float32 arrays are not copied.
pub struct Passes<'py> {
    color: PyReadonlyArrayDyn<'py, f32>,
    albedo: Option<PyReadonlyArrayDyn<'py, f32>>,
    normal: Option<PyReadonlyArrayDyn<'py, f32>>,
    depth: Option<PyReadonlyArrayDyn<'py, f32>>,
    vector: Option<PyReadonlyArrayDyn<'py, f32>>,
    aovs: Vec<(String, PyReadonlyArrayDyn<'py, f32>)>,
}

impl<'py> Passes<'py> {
    /// Takes the arrays; a TypeError or ValueError names the one that does not fit.
    pub fn new(given: &Given<'_, 'py>) -> PyResult<Self> {
        let color = floats("color", given.color)?;
        let (rows, columns) = match *color.shape() {
            [rows, columns, 3 | 4] if rows > 0 && columns > 0 => (rows, columns),
            ref shape => return Err(bad_shape("color", shape, "(height, width, 3) or (height, width, 4)")),
        };
        let pass = |name: &str, array: &Bound<'py, PyAny>, channels: Option<usize>| {
            let pass = floats(name, array)?;
            let expected: Vec<usize> = [rows, columns].into_iter().chain(channels).collect();
            match pass.shape() == expected {
                true => Ok(pass),
                false => Err(bad_shape(name, pass.shape(), &format!("{} like color", tuple(&expected)))),
            }
        };
        let guide = |name, array: Option<&Bound<'py, PyAny>>, channels| array.map(|a| pass(name, a, channels)).transpose();
        let mut aovs = Vec::new();
        for (name, array) in given.aovs.into_iter().flat_map(|aovs| aovs.iter()) {
            let name: String = name.extract().map_err(|_| PyTypeError::new_err("aovs: the keys must be names"))?;
            let image = pass(&format!("aovs[{name:?}]"), &array, Some(3))?;
            aovs.push((name, image));
        }
        Ok(Self {
            albedo: guide("albedo", given.albedo, Some(3))?,
            normal: guide("normal", given.normal, Some(3))?,
            depth: guide("depth", given.depth, None)?,
            vector: guide("vector", given.vector, Some(4))?,
            color,
            aovs,
        })
    }

    /// The same memory as the engine takes it.
    pub fn view(&self) -> PyResult<FrameView<'_>> {
        let color = view::<Ix3>(&self.color)?;
        let alpha = (color.dim().2 == 4).then(|| color.index_axis_move(Axis(2), 3));
        Ok(FrameView {
            colour: color.slice_move(s![.., .., ..3]),
            alpha,
            albedo: self.albedo.as_ref().map(view::<Ix3>).transpose()?,
            normal: self.normal.as_ref().map(view::<Ix3>).transpose()?,
            depth: self.depth.as_ref().map(view::<Ix2>).transpose()?,
            vector: self.vector.as_ref().map(view::<Ix3>).transpose()?,
            aovs: self.aovs.iter().map(|(name, image)| Ok((name.as_str(), view::<Ix3>(image)?))).collect::<PyResult<_>>()?,
            lambda_mask: None,
        })
    }
}

/// λ of a frame: a number, or an array of its (height, width) in which NaN means `otherwise`; None is `otherwise` everywhere. Values in
/// an array that are no λ are told by a UserWarning.
pub fn dial_of(given: Option<&Bound<'_, PyAny>>, (rows, columns): (usize, usize), otherwise: f32) -> PyResult<OwnedDial> {
    let Some(given) = given else { return Ok(otherwise.into()) };
    let is_array = given.py().import("numpy").is_ok() && given.cast::<PyUntypedArray>().is_ok_and(|array| array.ndim() > 0);
    if !is_array {
        let number: f64 = given.extract().map_err(|e: PyErr| PyTypeError::new_err(format!("lam: {}", e.value(given.py()))))?;
        return Ok(check_lam(number)?.into());
    }
    let array = floats("lam", given)?;
    if array.shape() != [rows, columns] {
        return Err(bad_shape("lam", array.shape(), &format!("{} like color, or a number", tuple(&[rows, columns]))));
    }
    let map = LambdaMap::new(view::<Ix2>(&array)?, otherwise)?;
    if let Some(note) = map.note() {
        let text = format!("lam: {note}: they are clamped, and NaN counts as {otherwise}");
        let text = std::ffi::CString::new(text).unwrap_or_default();
        PyErr::warn(given.py(), &given.py().get_type::<PyUserWarning>(), &text, 1)?;
    }
    Ok(map.into())
}

/// The result's colour, with alpha where the input had it: (rows, columns, 3 or 4).
pub fn color_of(denoised: Denoised) -> (Array3<f32>, Vec<(String, Array3<f32>)>) {
    let aovs = denoised.aovs.into_iter().map(|aov| (aov.name, aov.image)).collect();
    let Some(alpha) = denoised.alpha else { return (denoised.colour, aovs) };
    let (rows, columns, _) = denoised.colour.dim();
    let mut color = Array3::zeros((rows, columns, 4));
    color.slice_mut(s![.., .., ..3]).assign(&denoised.colour);
    color.slice_mut(s![.., .., 3]).assign(&alpha);
    (color, aovs)
}

/// An array of (rows, columns, 3 or 4) to write a result into.
pub struct Out<'py>(PyReadwriteArrayDyn<'py, f32>);

impl<'py> Out<'py> {
    /// Refuses an array that cannot take an image of this shape. `is_input`: it is `color` itself, which is borrowed while it is read.
    pub fn check(array: &Bound<'py, PyAny>, shape: &[usize], is_input: bool) -> PyResult<()> {
        let array = Self::fitting(array, shape)?;
        if is_input {
            let writable: bool = array.getattr("flags")?.getattr("writeable")?.extract()?;
            return if writable { Ok(()) } else { Err(PyValueError::new_err("out: color cannot be written")) };
        }
        Self::borrowed(&array).map(drop)
    }

    /// The array, to write into; the same is refused as by [`check`](Self::check).
    pub fn new(array: &Bound<'py, PyAny>, shape: &[usize]) -> PyResult<Self> {
        Self::borrowed(&Self::fitting(array, shape)?)
    }

    fn fitting(array: &Bound<'py, PyAny>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let good = |a: &&Bound<'py, PyArrayDyn<f32>>| a.is_aligned() && a.is_c_contiguous();
        let Some(array) = array.cast::<PyArrayDyn<f32>>().ok().filter(good) else {
            return Err(PyTypeError::new_err("out: expected a C-contiguous float32 array: numpy.empty_like(color, order='C')"));
        };
        if array.shape() != shape {
            return Err(bad_shape("out", array.shape(), &format!("{} like color", tuple(shape))));
        }
        Ok(array.clone())
    }

    fn borrowed(array: &Bound<'py, PyArrayDyn<f32>>) -> PyResult<Self> {
        let refused = |e: BorrowError| match e {
            BorrowError::AlreadyBorrowed => {
                "out: it shares memory with an input; give color itself, or an array of its own".into()
            }
            other => format!("out: {other}"),
        };
        array.try_readwrite().map(Self).map_err(|e| PyValueError::new_err(refused(e)))
    }

    /// The memory.
    pub fn view(&mut self) -> PyResult<ArrayViewMut3<'_, f32>> {
        self.0.as_array_mut().into_dimensionality().map_err(|e| HushError::new_err(e.to_string()))
    }
}

/// An array that takes over the image's memory.
pub fn to_numpy(py: Python<'_>, image: Array3<f32>) -> Py<PyArray3<f32>> {
    PyArray3::from_owned_array(py, image).unbind()
}

/// A float array as float32, where it lies if it is float32 already.
fn floats<'py>(name: &str, array: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, f32>> {
    let py = array.py();
    // Without NumPy its bindings panic; an import raises.
    py.import("numpy")?;
    let Ok(any) = array.cast::<PyUntypedArray>() else {
        let kind = array.get_type().name()?;
        return Err(PyTypeError::new_err(format!(
            "{name}: expected a numpy array of float32, got {kind}: numpy.asarray({name}, dtype=numpy.float32)"
        )));
    };
    let array = match any.cast::<PyArrayDyn<f32>>() {
        Ok(array) if array.is_aligned() => array.clone(),
        _ if any.dtype().kind() == b'f' => any.call_method1("astype", (dtype::<f32>(py),))?.cast_into::<PyArrayDyn<f32>>()?,
        _ => {
            return Err(PyTypeError::new_err(format!(
                "{name}: expected float32 (float16 and float64 are converted), got {}: passes are linear, not 8-bit pictures",
                any.dtype()
            )));
        }
    };
    array.try_readonly().map_err(|e| PyValueError::new_err(format!("{name}: is being written by another call: {e}")))
}

fn view<'a, D: Dimension>(array: &'a PyReadonlyArrayDyn<'_, f32>) -> PyResult<ArrayView<'a, f32, D>> {
    let view: ArrayView<'a, f32, IxDyn> = array.as_array();
    view.into_dimensionality().map_err(|e| HushError::new_err(e.to_string()))
}

fn bad_shape(name: &str, shape: &[usize], expected: &str) -> PyErr {
    PyValueError::new_err(format!("{name}: shape {}, expected {expected}", tuple(shape)))
}

/// A shape as Python writes it.
fn tuple(shape: &[usize]) -> String {
    let sizes: Vec<String> = shape.iter().map(usize::to_string).collect();
    format!("({}{})", sizes.join(", "), if sizes.len() == 1 { "," } else { "" })
}
