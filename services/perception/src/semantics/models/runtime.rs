//! ONNX Runtime, and models opened in it: the one place that knows the library.
//!
//! The library is loaded when a model is opened and never linked: a robot whose models run elsewhere needs
//! none. Where it is and what runs the models is configuration; how many threads they take is capped,
//! because perception must not starve the filter. Not here: what any model's numbers mean.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, anyhow, bail, ensure};
use ort::session::builder::GraphOptimizationLevel;
use ort::session::{Session, SessionInputValue};
use ort::value::{Tensor, TensorElementType, ValueType};
use serde::{Deserialize, Serialize};

/// Where the library's path is looked for when the configuration names none.
pub const LIBRARY_VARIABLE: &str = "ORT_DYLIB_PATH";
/// How a person gets the library: measured to work with python3-pip and unzip, nothing else.
pub const LIBRARY_COMMAND: &str = "pip download --no-deps -d wheel onnxruntime==1.24.1 && \
     unzip -jo wheel/onnxruntime-*.whl 'onnxruntime/capi/libonnxruntime.so*' -d lib";

/// The library and its environment, once started.
static STARTED: Mutex<Option<(PathBuf, ort::environment::Environment)>> = Mutex::new(None);

/// What runs a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Provider {
    /// Any processor.
    Cpu,
    /// NVIDIA's, by CUDA.
    Cuda,
    /// NVIDIA's, by TensorRT.
    Tensorrt,
    /// Intel's, by OpenVINO.
    Openvino,
    /// Small processors, by XNNPACK.
    Xnnpack,
}

/// Section `[semantics.onnx]`: the library and what it may use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RuntimeSettings {
    /// The library, `libonnxruntime.so…`; empty: the variable `ORT_DYLIB_PATH`.
    pub library: PathBuf,
    /// What runs the models, best first; the processor is always the last resort.
    pub providers: Vec<Provider>,
    /// Threads that one model may use.
    pub n_threads: usize,
}

impl Default for RuntimeSettings {
    /// The processor, with two threads.
    fn default() -> Self {
        RuntimeSettings { library: PathBuf::new(), providers: vec![Provider::Cpu], n_threads: 2 }
    }
}

impl RuntimeSettings {
    /// The same, with a path that starts at `folder`.
    #[must_use]
    pub fn within(mut self, folder: &Path) -> Self {
        if !self.library.as_os_str().is_empty() {
            self.library = folder.join(&self.library);
        }
        self
    }
}

/// The library, loaded.
pub struct Runtime {
    environment: ort::environment::Environment,
    settings: RuntimeSettings,
    /// The library's file.
    pub library: PathBuf,
}

impl Runtime {
    /// Loads the library.
    ///
    /// # Errors
    /// When there is none, or it is none of the versions that are known to work; says how to get it.
    pub fn load(settings: &RuntimeSettings) -> anyhow::Result<Self> {
        let library = library_file(settings)?;
        // The library allows one environment in a process; it is started once and shared.
        let mut started = STARTED.lock().unwrap_or_else(PoisonError::into_inner);
        let environment = match &*started {
            Some((first, environment)) => {
                ensure!(
                    *first == library,
                    "ONNX Runtime: {} is loaded already, {} cannot be beside it",
                    first.display(),
                    library.display()
                );
                environment.clone()
            }
            None => {
                let builder = ort::init_from(&library)
                    .map_err(|e| anyhow!("ONNX Runtime: {e}; get one that works by: {LIBRARY_COMMAND}"))?;
                let environment = builder
                    .with_name("heedway")
                    .with_telemetry(false)
                    .build()
                    .context("start ONNX Runtime")?;
                *started = Some((library.clone(), environment.clone()));
                environment
            }
        };
        Ok(Runtime { environment, settings: settings.clone(), library })
    }

    /// Opens a model.
    ///
    /// # Errors
    /// When the file is missing or no model, with the file's name.
    pub fn open(&self, file: &Path) -> anyhow::Result<Model> {
        let name = file.display().to_string();
        ensure!(file.is_file(), "model {name}: no such file");
        let session = self.session(file).map_err(|reason| anyhow!("model {name}: {reason}"))?;
        let ports = |outlets: &[ort::value::Outlet]| -> anyhow::Result<Vec<Port>> {
            outlets.iter().map(|outlet| Port::of(outlet).with_context(|| format!("model {name}"))).collect()
        };
        let (inputs, outputs) = (ports(session.inputs())?, ports(session.outputs())?);
        Ok(Model { name, inputs, outputs, session: Mutex::new(session) })
    }

    fn session(&self, file: &Path) -> Result<Session, String> {
        let words = |e: &dyn std::fmt::Display| e.to_string();
        let mut builder = Session::builder(&self.environment)
            .map_err(|e| words(&e))?
            .with_optimization_level(GraphOptimizationLevel::All)
            .map_err(|e| words(&e))?
            .with_intra_threads(self.settings.n_threads)
            .map_err(|e| words(&e))?
            .with_inter_threads(1)
            .map_err(|e| words(&e))?
            // A thread that spins while it waits for work takes the filter's core.
            .with_intra_op_spinning(false)
            .map_err(|e| words(&e))?;
        let wanted: Vec<_> = self.settings.providers.iter().filter_map(|p| dispatch(*p)).collect();
        if !wanted.is_empty() {
            builder = builder.with_execution_providers(&wanted).map_err(|e| words(&e))?;
        }
        builder.commit_from_file(file).map_err(|e| words(&e))
    }
}

/// Asked for by name, so a provider that cannot run is an error and not a silent, slow success.
fn dispatch(provider: Provider) -> Option<ort::ep::ExecutionProviderDispatch> {
    match provider {
        Provider::Cpu => None,
        Provider::Cuda => Some(ort::ep::CUDA::default().build().error_on_failure()),
        Provider::Tensorrt => Some(ort::ep::TensorRT::default().build().error_on_failure()),
        Provider::Openvino => Some(ort::ep::OpenVINO::default().build().error_on_failure()),
        Provider::Xnnpack => Some(ort::ep::XNNPACK::default().build().error_on_failure()),
    }
}

fn library_file(settings: &RuntimeSettings) -> anyhow::Result<PathBuf> {
    let (file, whence) = if settings.library.as_os_str().is_empty() {
        let named = std::env::var_os(LIBRARY_VARIABLE).filter(|value| !value.is_empty());
        let Some(named) = named else {
            bail!(
                "ONNX Runtime: no library, neither as `library` in the section [semantics.onnx] nor as \
                 {LIBRARY_VARIABLE}; get it by: {LIBRARY_COMMAND}"
            );
        };
        (PathBuf::from(named), LIBRARY_VARIABLE)
    } else {
        (settings.library.clone(), "`library` in the section [semantics.onnx]")
    };
    // The library would take a path that is not absolute to start at the program, not where we are.
    let absolute = file.canonicalize();
    absolute.map_err(|e| {
        anyhow!("ONNX Runtime: {} ({whence}): {e}; get it by: {LIBRARY_COMMAND}", file.display())
    })
}

/// One input or output of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Its name.
    pub name: String,
    /// Its sides; −1 is any.
    pub shape: Vec<i64>,
    /// Whether it holds whole numbers, else floats.
    pub is_whole: bool,
}

impl Port {
    fn of(outlet: &ort::value::Outlet) -> anyhow::Result<Self> {
        let name = outlet.name().to_owned();
        let ValueType::Tensor { ty, shape, .. } = outlet.dtype() else { bail!("`{name}` is no tensor") };
        let is_whole = match ty {
            TensorElementType::Float32 => false,
            TensorElementType::Int64 => true,
            other => bail!("`{name}` holds {other}, must be f32 or i64"),
        };
        Ok(Port { name, shape: shape.to_vec(), is_whole })
    }
}

/// Numbers for a model, row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum Numbers {
    /// Floats.
    Floats(Vec<f32>),
    /// Whole numbers.
    Wholes(Vec<i64>),
}

/// What a model gave back, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Floats {
    /// Sides.
    pub shape: Vec<usize>,
    /// As many as the sides multiplied.
    pub values: Vec<f32>,
}

/// A model, open.
pub struct Model {
    /// Its file, for messages.
    pub name: String,
    /// What it takes.
    pub inputs: Vec<Port>,
    /// What it gives.
    pub outputs: Vec<Port>,
    session: Mutex<Session>,
}

impl Model {
    /// The input or output of a name.
    ///
    /// # Errors
    /// When there is none; says which there are.
    pub fn port<'a>(&self, ports: &'a [Port], name: &str) -> anyhow::Result<&'a Port> {
        let names = || ports.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
        ports
            .iter()
            .find(|port| port.name == name)
            .ok_or_else(|| anyhow!("model {}: no `{name}`, there are: {}", self.name, names()))
    }

    /// Checks the sides of an input or output; `None` is any.
    ///
    /// # Errors
    /// When they are others: names the model, what it has and what it must have.
    pub fn check(&self, port: &Port, wanted: &[Option<usize>]) -> anyhow::Result<()> {
        let fits = |(found, wanted): (&i64, &Option<usize>)| {
            *found < 0 || wanted.is_none_or(|w| usize::try_from(*found) == Ok(w))
        };
        if port.shape.len() == wanted.len() && port.shape.iter().zip(wanted).all(fits) {
            return Ok(());
        }
        let wanted: Vec<String> =
            wanted.iter().map(|w| w.map_or_else(|| "any".to_owned(), |w| w.to_string())).collect();
        bail!("model {}: `{}` is {:?}, must be [{}]", self.name, port.name, port.shape, wanted.join(", "))
    }

    /// Runs it on inputs by name; gives all outputs in their order.
    ///
    /// # Errors
    /// When the model refuses or gives what is no float.
    pub fn run(&self, inputs: Vec<(&str, Vec<usize>, Numbers)>) -> anyhow::Result<Vec<Floats>> {
        let mut values: Vec<(&str, SessionInputValue<'_>)> = Vec::with_capacity(inputs.len());
        for (name, shape, numbers) in inputs {
            let value = match numbers {
                Numbers::Floats(floats) => Tensor::from_array((shape, floats))?.into_dyn(),
                Numbers::Wholes(wholes) => Tensor::from_array((shape, wholes))?.into_dyn(),
            };
            values.push((name, value.into()));
        }
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let outputs = session.run(values).map_err(|e| anyhow!("model {}: {e}", self.name))?;
        let mut all = Vec::with_capacity(self.outputs.len());
        for port in &self.outputs {
            let output =
                outputs.get(&port.name).ok_or_else(|| anyhow!("model {}: no {}", self.name, port.name))?;
            let (shape, values) = output
                .try_extract_tensor::<f32>()
                .map_err(|e| anyhow!("model {}: `{}`: {e}", self.name, port.name))?;
            let shape = shape.iter().map(|side| usize::try_from(*side).unwrap_or(0)).collect();
            all.push(Floats { shape, values: values.to_vec() });
        }
        Ok(all)
    }
}
