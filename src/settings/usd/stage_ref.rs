//! A stage and perhaps a prim in it: `shot.usda@/Render/Pass`.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::error::Error;

/// A stage, and the prim that the settings start from; without one the stage has to have a single one to choose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageRef {
    /// A `.usda`, `.usdc`, `.usd` or `.usdz` file.
    pub file: PathBuf,
    /// An absolute prim path.
    pub prim: Option<String>,
}

impl StageRef {
    /// The same stage, its file taken from a folder.
    pub fn from(self, folder: &Path) -> Self {
        Self { file: folder.join(self.file), ..self }
    }
}

impl FromStr for StageRef {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        // Only `@/` separates, as file names may hold an @.
        let (file, prim) = text.rsplit_once("@/").map_or((text, None), |(file, prim)| (file, Some(format!("/{prim}"))));
        match file.is_empty() {
            true => {
                Err(Error::BadSetting { name: "usd", reason: format!("'{text}': write shot.usda or shot.usda@/Render/Pass") })
            }
            false => Ok(Self { file: file.into(), prim }),
        }
    }
}

impl Display for StageRef {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        self.prim.iter().try_for_each(|prim| write!(f, "@{prim}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prim_stands_behind_the_last_at() {
        for (text, file, prim) in [
            ("a.usda", "a.usda", None),
            ("a.usda@/Render/Pass", "a.usda", Some("/Render/Pass")),
            ("me@home.usdc", "me@home.usdc", None),
            ("me@home.usdc@/R", "me@home.usdc", Some("/R")),
        ] {
            let stage: StageRef = text.parse().unwrap();
            assert_eq!((stage.file.to_str().unwrap(), stage.prim.as_deref()), (file, prim));
            assert_eq!(stage.to_string(), text);
        }
        assert!("".parse::<StageRef>().is_err() && "@/Render".parse::<StageRef>().is_err());
    }
}
