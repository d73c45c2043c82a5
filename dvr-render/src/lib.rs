//! From an implicit field to pictures and meshes.
#![warn(missing_docs)]

pub mod extract;
mod field;
mod implicit_depth;
mod march;
mod rays;
mod root;
mod skip;
mod surface;
mod view;

pub use field::{Field, FieldJet, FieldValues, Query, axis_direction};
pub use implicit_depth::{SlopeRule, dot, implicit_depth};
pub use march::{Hits, March, MarchSettings, Marcher, TensorMarcher};
pub use rays::Rays;
pub use root::{Bracket, RootMethod};
pub use skip::SkipGrid;
pub use surface::Surface;
pub use view::{RenderSettings, Rendering, Shaded, render_view, shade_rays};
