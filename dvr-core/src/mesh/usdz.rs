//! Writing USDZ, which phones and tablets of Apple show without an app. (`openusd.org/release/spec_usdz.html`; materials:
//! `openusd.org/release/spec_usdpreviewsurface.html`.)
//!
//! The scene inside is text (USDA): binary layers that the `openusd` crate (0.6) writes are refused by OpenUSD 26.11.

use std::fmt::{Display, Write as _};
use std::io::{Cursor, Write as _};
use std::path::Path;

use glam::{Vec2, Vec3};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::GENERATOR;
use super::io::stem;
use super::triangle_mesh::Mesh;
use super::write_textured::{Look, StoredTexture};
use crate::error::{Error, Result};
use crate::srgb::srgb_to_linear;

/// Readers map the parts of a package into memory, at multiples of this many bytes.
const ALIGNMENT: u16 = 64;

/// A picture and the name of its file inside the package.
pub(super) struct Picture<'a> {
    pub stored: &'a StoredTexture,
    pub name: &'a str,
}

/// What covers the surface.
pub(super) enum Cover<'a> {
    /// The colours of the vertices, where there are any.
    Vertices,
    /// A texture, and a normal map.
    Texture { uvs: &'a [Vec2], color: Picture<'a>, normals: Option<Picture<'a>> },
}

/// A mesh as a package: one layer and its pictures, stored uncompressed. Its unit is the metre and its y axis points up, as
/// glTF has it. The object has the name of the file at `path`, with what USD does not take in a name replaced by `_`.
///
/// # Errors
/// When it is larger than an archive may be (4 GiB).
pub(super) fn encode(path: &Path, mesh: &Mesh, cover: &Cover, look: Look) -> Result<Vec<u8>> {
    let layer = layer(mesh, cover, look, &identifier(&stem(path)));
    let mut files = vec![("model.usda", layer.as_bytes())];
    if let Cover::Texture { color, normals, .. } = cover {
        files.push((color.name, &color.stored.bytes));
        files.extend(normals.as_ref().map(|normals| (normals.name, &normals.stored.bytes[..])));
    }
    package(&files).map_err(|error| Error::io(path, std::io::Error::other(error)))
}

fn package(files: &[(&str, &[u8])]) -> zip::result::ZipResult<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in files {
        // Without the time, the same mesh gives the same bytes.
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(*name, stored.with_alignment(ALIGNMENT).last_modified_time(zip::DateTime::default()))?;
        zip.write_all(bytes)?;
    }
    Ok(zip.finish()?.into_inner())
}

/// Letters, digits and underscores, none of the digits first.
fn identifier(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if plain.starts_with(|c: char| c.is_ascii_digit()) || plain.is_empty() { format!("_{plain}") } else { plain }
}

/// The scene: a transform that holds the mesh and its material. An empty mesh gives an empty one.
fn layer(mesh: &Mesh, cover: &Cover, look: Look, name: &str) -> String {
    let contents = if mesh.is_empty() {
        String::new()
    } else {
        mesh_prim(mesh, cover, name) + &material(cover, look, name, mesh.colors.is_some())
    };
    format!(
        r#"#usda 1.0
(
    defaultPrim = "{name}"
    doc = "{GENERATOR}"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "{name}" (
    kind = "component"
)
{{
{contents}}}
"#
    )
}

fn mesh_prim(mesh: &Mesh, cover: &Cover, name: &str) -> String {
    let (low, high) = mesh.bounds().unwrap_or_default();
    let extent = list([low, high].map(tuple3));
    let counts = list(mesh.faces.iter().map(|_| 3));
    let indices = list(mesh.faces.iter().flatten());
    let points = list(mesh.vertices.iter().copied().map(tuple3));
    let mut text = format!(
        r#"    def Mesh "mesh" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        rel material:binding = </{name}/material>
        uniform bool doubleSided = 1
        uniform token subdivisionScheme = "none"
        float3[] extent = {extent}
        int[] faceVertexCounts = {counts}
        int[] faceVertexIndices = {indices}
        point3f[] points = {points}
"#
    );
    let mut per_vertex = |property: &str, values: String| {
        let _ = writeln!(text, "        {property} = {values} (\n            interpolation = \"vertex\"\n        )");
    };
    if let Some(normals) = &mesh.normals {
        let unit = normals.iter().map(|normal| tuple3(normal.normalize_or(Vec3::Y)));
        per_vertex("normal3f[] normals", list(unit));
    }
    if let Some(colors) = &mesh.colors {
        let linear = colors.iter().map(|color| tuple3(color.map(|c| srgb_to_linear(c.clamp(0.0, 1.0))).into()));
        per_vertex("color3f[] primvars:displayColor", list(linear));
    }
    if let Cover::Texture { uvs, .. } = cover {
        per_vertex("texCoord2f[] primvars:st", list(uvs.iter().map(|uv| format!("({}, {})", uv.x, uv.y))));
    }
    text + "    }\n"
}

fn material(cover: &Cover, look: Look, name: &str, has_colors: bool) -> String {
    let at = format!("/{name}/material");
    let mut surface = Vec::new();
    let color_input = match look {
        Look::Material => "color3f inputs:diffuseColor",
        // There is no unlit material: a surface that shines by itself, is black, and mirrors nothing, is one.
        Look::Baked => {
            surface.push("color3f inputs:diffuseColor = (0, 0, 0)".to_owned());
            surface.push("float inputs:ior = 1".to_owned());
            "color3f inputs:emissiveColor"
        }
    };
    surface.push("float inputs:metallic = 0".to_owned());
    surface.push("float inputs:roughness = 1".to_owned());
    let mut shaders = String::new();
    let primvar = |kind: &str, varname: &str| {
        let inputs = [format!("string inputs:varname = \"{varname}\""), format!("{kind} outputs:result")];
        shader(varname, &format!("UsdPrimvarReader_{kind}"), &inputs)
    };
    match cover {
        Cover::Vertices if has_colors => {
            shaders += &primvar("float3", "displayColor");
            surface.push(format!("{color_input}.connect = <{at}/displayColor.outputs:result>"));
        }
        Cover::Vertices => {}
        Cover::Texture { color, normals, .. } => {
            shaders += &primvar("float2", "st");
            shaders += &texture("color", color, "sRGB", &at, &[]);
            surface.push(format!("{color_input}.connect = <{at}/color.outputs:rgb>"));
            if let Some(normals) = normals {
                // Bytes to directions, as the specification has it for normal maps of 8 bits.
                let range = ["float4 inputs:scale = (2, 2, 2, 1)", "float4 inputs:bias = (-1, -1, -1, 0)"];
                shaders += &texture("normals", normals, "raw", &at, &range);
                surface.push(format!("normal3f inputs:normal.connect = <{at}/normals.outputs:rgb>"));
            }
        }
    }
    surface.push("token outputs:surface".to_owned());
    let surface = shader("surface", "UsdPreviewSurface", &surface);
    format!(
        r#"
    def Material "material"
    {{
        token outputs:surface.connect = <{at}/surface.outputs:surface>

{surface}{shaders}    }}
"#
    )
}

/// A shader that reads a picture.
fn texture(name: &str, picture: &Picture, space: &str, material: &str, more: &[&str]) -> String {
    let mut properties = vec![
        format!("asset inputs:file = @{}@", picture.name),
        format!("token inputs:sourceColorSpace = \"{space}\""),
        format!("float2 inputs:st.connect = <{material}/st.outputs:result>"),
        "token inputs:wrapS = \"clamp\"".to_owned(),
        "token inputs:wrapT = \"clamp\"".to_owned(),
    ];
    properties.extend(more.iter().map(|line| (*line).to_owned()));
    properties.push("float3 outputs:rgb".to_owned());
    shader(name, "UsdUVTexture", &properties)
}

fn shader(name: &str, id: &str, properties: &[String]) -> String {
    let lines: String = properties.iter().map(|line| format!("            {line}\n")).collect();
    format!(
        "        def Shader \"{name}\"\n        {{\n            uniform token info:id = \"{id}\"\n{lines}        }}\n"
    )
}

fn tuple3(v: Vec3) -> String {
    format!("({}, {}, {})", v.x, v.y, v.z)
}

fn list<T: Display>(values: impl IntoIterator<Item = T>) -> String {
    let mut text = String::from("[");
    for (index, value) in values.into_iter().enumerate() {
        let _ = write!(text, "{}{value}", if index == 0 { "" } else { ", " });
    }
    text + "]"
}
