//! What follows in Rust from the table of settings.

/// Declares [`ShotSettings`](super::ShotSettings) with a field for each setting, and [`SETTINGS`](super::SETTINGS).
macro_rules! settings {
    ($(#[doc = $help:literal] $field:ident: $type:ty { $($key:ident: $value:expr),+ $(,)? })+) => {
        /// What may be said about a shot. None: not said.
        ///
        /// Serde reads it from and writes it to a map from the settings' names to their values.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct ShotSettings {
            $(#[doc = $help] pub $field: Option<$type>,)+
        }

        /// All settings, in the order in which they are shown.
        pub static SETTINGS: &[$crate::settings::Setting] = &[
            $($crate::settings::Setting {
                $($key: $crate::settings::declare::said!($key, $value),)+
                ..$crate::settings::Setting::new(stringify!($field), $help)
            },)+
        ];

        impl ShotSettings {
            /// A setting's value as JSON, null where nothing was said and for a name that is none.
            pub fn get(&self, name: &str) -> serde_json::Value {
                match &*name.replace('.', "_") {
                    $(stringify!($field) => serde_json::to_value(&self.$field).unwrap_or_default(),)+
                    _ => serde_json::Value::Null,
                }
            }

            /// Says a setting.
            ///
            /// # Errors
            /// A name that is none, with the nearest one; a value of another type or out of range.
            pub fn set(&mut self, name: &str, value: serde_json::Value) -> Result<(), super::Unfit> {
                let setting = super::Setting::named(name)?;
                let value = setting.kind.canonical(value)?;
                let wrong = |e: serde_json::Error| super::Unfit::Value(e.to_string());
                match &*name.replace('.', "_") {
                    $(stringify!($field) => self.$field = Some(serde_json::from_value(value).map_err(wrong)?),)+
                    _ => {}
                }
                Ok(())
            }

            /// Takes over every value that `stronger` has.
            pub(crate) fn take(&mut self, stronger: Self) {
                $(if stronger.$field.is_some() { self.$field = stronger.$field; })+
            }
        }
    };
}

/// A part of a declaration as [`Setting`](super::Setting) holds it.
macro_rules! said {
    (option, $value:expr) => {
        Some($value)
    };
    (short, $value:expr) => {
        Some($value)
    };
    (python, $value:expr) => {
        Some($value)
    };
    ($key:ident, $value:expr) => {
        $value
    };
}

pub(super) use {said, settings};
