//! Files, datasets and meshes, through the public functions.

mod compressed_glb;
mod mask_exactness;
mod mesh_files;
mod region_of_interest;
mod synthetic_datasets;
mod textured_mesh_files;
mod usdz;
