//! Which device is to weigh, in a user's words. Known to builds without GPU support too, which then say what they lack.

/// Which device a user asks for.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// A real GPU where there is one and the work is worth its start.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// A real GPU.
    Gpu,
    /// The first device whose name holds this, in capitals or not; `lavapipe` is also called `llvmpipe`.
    Named(String),
}

impl DeviceChoice {
    /// Whether a device was asked for in so many words.
    pub fn insists(&self) -> bool {
        matches!(self, DeviceChoice::Gpu | DeviceChoice::Named(_))
    }
}

impl std::str::FromStr for DeviceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(DeviceChoice::Auto),
            "cpu" => Ok(DeviceChoice::Cpu),
            "gpu" => Ok(DeviceChoice::Gpu),
            _ => match text.strip_prefix("gpu:") {
                Some(name) if !name.trim().is_empty() => Ok(DeviceChoice::Named(name.trim().to_string())),
                _ => Err("a device is auto, cpu, gpu or gpu:NAME; `lodestream devices` lists names".to_string()),
            },
        }
    }
}

impl std::fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            DeviceChoice::Auto => f.write_str("auto"),
            DeviceChoice::Cpu => f.write_str("cpu"),
            DeviceChoice::Gpu => f.write_str("gpu"),
            DeviceChoice::Named(name) => write!(f, "gpu:{name}"),
        }
    }
}
