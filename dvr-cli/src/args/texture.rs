//! `dvr texture`, and how other commands make textures.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dvr_core::mesh::{Look, MeshStyle};
use dvr_texture::{SIZES, TextureSettings, TextureSize};

use super::faces::{FaceBudget, parse_faces};
use super::preset::PresetArg;
use super::scene::SceneArgs;

/// Arguments of `dvr texture`.
#[derive(Args, Debug)]
#[command(after_long_help = AFTER_HELP)]
pub struct TextureArgs {
    /// Mesh to colour: OBJ, PLY, OFF, glTF or GLB, in the coordinates and units of the scene's files, faces winding
    /// counter-clockwise seen from outside
    pub mesh: PathBuf,
    /// Scene whose photographs give the colours
    #[arg(long, value_name = "SCENE")]
    pub data: PathBuf,
    /// Output file, .glb or .usdz (texture inside), or .obj (with .mtl and .png beside it)
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
    /// Replace the files at --out
    #[arg(long)]
    pub overwrite: bool,
    /// Texels along the texture's edge: auto, at which a texel is about as large as a pixel of the photographs, less where
    /// memory is short, or a number [128 to 16384; default: auto]
    #[arg(long, value_parser = parse_texture_size, value_name = "N")]
    pub size: Option<TextureSize>,
    /// Simplify the mesh first, to at most so many faces, those first whose loss moves the surface least: full, or a
    /// number, e.g. 5k, 50k or 200k [from 4 to 100M; default: full, or what --preset says]
    #[arg(long, value_parser = parse_faces, value_name = "N")]
    pub faces: Option<FaceBudget>,
    /// Make the triangles near equilateral first, all about the same size (isotropic remeshing), about as many as --faces or
    /// --preset says, or as the mesh has; sharp edges are kept
    #[arg(long)]
    pub remesh: bool,
    #[command(flatten)]
    pub preset: PresetArg,
    #[command(flatten)]
    pub finish: FinishArgs,
    /// Colour from all views, also from those that a run would leave out for validation and testing: `dvr eval` then
    /// measures what the texture was made from
    #[arg(long)]
    pub all_views: bool,
    #[command(flatten)]
    pub reading: SceneArgs,
}

const AFTER_HELP: &str = "Examples:
  dvr texture scan.ply --data photos/ --out scan.glb
  dvr texture repaired.obj --data photos/ --size 4096 --out repaired.obj --overwrite
  dvr texture scan.ply --data photos/ --preset web --out small.glb
  dvr eval scan.glb --data photos/

Each texel takes the mean of the photographs that see it and agree; least squares over all pixels make it sharp. Surface \
that no photograph sees keeps the mesh's own vertex colours, or takes those around.";

/// What viewers do with the colours of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LookArg {
    /// Show them as they are: the light of the photographs is in them (KHR_materials_unlit)
    Baked,
    /// Light them, as a rough surface
    Material,
}

impl LookArg {
    /// The library's look.
    pub fn look(self) -> Look {
        match self {
            Self::Baked => Look::Baked,
            Self::Material => Look::Material,
        }
    }
}

/// Whether and how a command makes a texture.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct TextureArg {
    /// Texture of the GLB (and of OBJ and USDZ with `dvr mesh`) from the photographs: off, auto, at which a texel is about as large
    /// as a pixel, less where memory is short, or texels along its edge [128 to 16384; default: auto]. It costs some
    /// seconds at the end; PLY has colours per vertex
    #[arg(long, value_parser = parse_texture, value_name = "N")]
    pub texture: Option<TextureChoice>,
    #[command(flatten)]
    pub finish: FinishArgs,
}

/// What a file with a texture says besides.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct FinishArgs {
    /// What viewers do with the colours of the texture
    #[arg(long, value_enum, default_value_t = LookArg::Baked)]
    pub look: LookArg,
    /// Give the GLB or USDZ of a simplified mesh with a texture the normals of the full one as a texture, in tangent space
    /// [default: on with --look material, where viewers light the surface]
    #[arg(long, value_enum, value_name = "WHETHER")]
    pub normal_map: Option<NormalMapChoice>,
    /// Compress vertices and faces of the GLB (EXT_meshopt_compression): a quarter of their bytes or less; three.js opens it with its
    /// MeshoptDecoder, Blender 3.4 does not
    #[arg(long)]
    pub compress: bool,
}

impl FinishArgs {
    /// How files are written.
    pub fn style(&self) -> MeshStyle {
        MeshStyle { look: self.look.look(), is_compressed: self.compress }
    }

    /// Whether a simplified mesh gets a normal map: where nothing is said, if it will be lit.
    pub fn has_normal_map(&self) -> bool {
        let choice = self.normal_map.unwrap_or(match self.look {
            LookArg::Baked => NormalMapChoice::Off,
            LookArg::Material => NormalMapChoice::On,
        });
        choice == NormalMapChoice::On
    }
}

/// Whether a mesh has a normal map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NormalMapChoice {
    /// Where the mesh was simplified and has a texture
    On,
    /// Never
    Off,
}

/// The value of `--texture`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureChoice {
    /// No texture.
    Off,
    /// A texture of this size.
    Of(TextureSize),
}

impl TextureArg {
    /// The library's settings; `None` for no texture.
    pub fn settings(self, preset: PresetArg) -> Option<TextureSettings> {
        match self.texture {
            Some(TextureChoice::Off) => None,
            Some(TextureChoice::Of(size)) => Some(texture_settings(Some(size), preset)),
            None => Some(texture_settings(None, preset)),
        }
    }
}

/// The library's settings for a size that was asked for, or else the preset's.
pub fn texture_settings(size: Option<TextureSize>, preset: PresetArg) -> TextureSettings {
    let default = TextureSettings::default();
    match (size, preset.max_texels()) {
        (Some(size), _) => TextureSettings { size, ..default },
        (None, Some(largest_auto)) => TextureSettings { largest_auto, ..default },
        (None, None) => default,
    }
}

/// Reads `auto` or a number of texels.
pub(super) fn parse_texture_size(text: &str) -> Result<TextureSize, String> {
    let size = if text == "auto" { Some(TextureSize::Auto) } else { text.parse().ok().map(TextureSize::Texels) };
    let size = size.filter(|size| size.check().is_ok());
    size.ok_or_else(|| format!("write auto, or a number of texels from {} to {}", SIZES.start(), SIZES.end()))
}

/// Reads `off`, `auto` or a number of texels.
pub(super) fn parse_texture(text: &str) -> Result<TextureChoice, String> {
    if text == "off" {
        return Ok(TextureChoice::Off);
    }
    let of = parse_texture_size(text).map(TextureChoice::Of);
    of.map_err(|problem| problem.replacen("write auto", "write off, auto", 1))
}

#[cfg(test)]
mod tests {
    use super::super::preset::Preset;
    use super::*;

    #[test]
    fn the_preset_limits_a_size_that_was_not_asked_for() {
        let web = PresetArg { preset: Preset::Web };
        let finish = FinishArgs { look: LookArg::Baked, normal_map: None, compress: false };
        let of = |texture: Option<TextureChoice>| TextureArg { texture, finish }.settings(web);
        assert_eq!(of(None).map(|settings| (settings.size, settings.largest_auto)), Some((TextureSize::Auto, 2048)));
        let asked = of(Some(TextureChoice::Of(TextureSize::Auto))).unwrap();
        assert_eq!(asked, TextureSettings::default());
        assert_eq!(of(Some(TextureChoice::Of(TextureSize::Texels(4096)))).unwrap().size, TextureSize::Texels(4096));
        assert_eq!(of(Some(TextureChoice::Off)), None);
    }

    #[test]
    fn sizes_of_textures_are_read_or_refused() {
        assert_eq!(parse_texture_size("auto"), Ok(TextureSize::Auto));
        assert_eq!(parse_texture("2048"), Ok(TextureChoice::Of(TextureSize::Texels(2048))));
        assert_eq!(parse_texture("off"), Ok(TextureChoice::Off));
        for wrong in ["127", "16385", "-1", "big", "", "1e3"] {
            let said = parse_texture(wrong).unwrap_err();
            assert!(said.contains("off") && said.contains("from 128 to 16384"), "{said}");
            assert!(parse_texture_size(wrong).is_err());
        }
    }
}
