//! What a mesh is for: `--preset`.

use clap::{Args, ValueEnum};

use super::faces::FaceBudget;

/// What a mesh is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Web pages and phones: 50k faces, a texture of at most 2048 texels
    Web,
    /// 3D printing: 200k faces, watertight
    Print,
    /// All faces
    Full,
}

/// Which preset.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct PresetArg {
    /// What the mesh is for; --faces and the size of the texture replace what it says
    #[arg(long, value_enum, default_value_t = Preset::Full)]
    pub preset: Preset,
}

impl PresetArg {
    /// Faces that the mesh may have, where there is a limit; `given` counts first.
    pub fn max_faces(self, given: Option<FaceBudget>) -> Option<usize> {
        let own = match self.preset {
            Preset::Web => FaceBudget::AtMost(50_000),
            Preset::Print => FaceBudget::AtMost(200_000),
            Preset::Full => FaceBudget::Full,
        };
        given.unwrap_or(own).limit()
    }

    /// Texels along the edge of a texture whose size was not asked for, at most.
    pub fn max_texels(self) -> Option<u32> {
        (self.preset == Preset::Web).then_some(2048)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_asked_for_counts_before_the_preset() {
        let web = PresetArg { preset: Preset::Web };
        assert_eq!((web.max_faces(None), web.max_texels()), (Some(50_000), Some(2048)));
        assert_eq!(web.max_faces(Some(FaceBudget::AtMost(7))), Some(7));
        assert_eq!(web.max_faces(Some(FaceBudget::Full)), None);
        let full = PresetArg { preset: Preset::Full };
        assert_eq!((full.max_faces(None), full.max_texels()), (None, None));
    }
}
