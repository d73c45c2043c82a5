// Reads a run's mesh.glb: all faces and the whole texture, in place of what the page was given.
"use strict";

// What the viewer draws, of a binary glTF of one mesh with one texture; `toObject` takes the file's points to the page's.
function decodeGlb(buffer, toObject) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67) throw new Error("this is no binary glTF (.glb)");
  const length = view.getUint32(12, true);
  const root = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  const start = 20 + length + 8;
  const bytesOf = (index) => {
    const part = root.bufferViews[index];
    return buffer.slice(start + (part.byteOffset || 0), start + (part.byteOffset || 0) + part.byteLength);
  };
  const FLOAT = 5126, UINT = 5125;
  const values = (index, kind, Kind) => {
    const accessor = root.accessors[index];
    if (accessor.componentType !== kind) throw new Error("this is not the mesh.glb of a run");
    return new Kind(bytesOf(accessor.bufferView));
  };
  const primitive = root.meshes && root.meshes[0].primitives[0];
  const { POSITION, NORMAL, TEXCOORD_0, _CONFIDENCE, _VIEWS } = (primitive && primitive.attributes) || {};
  if (TEXCOORD_0 === undefined || NORMAL === undefined || !root.images) throw new Error("this mesh has no texture");
  const positions = values(POSITION, FLOAT, Float32Array);
  const normals = values(NORMAL, FLOAT, Float32Array);
  const uvs = values(TEXCOORD_0, FLOAT, Float32Array);
  for (let i = 1; i < uvs.length; i += 2) uvs[i] = 1 - uvs[i];
  const m = toObject;
  for (let i = 0; i < positions.length; i += 3) {
    const [x, y, z] = positions.subarray(i, i + 3);
    const [a, b, c] = normals.subarray(i, i + 3);
    for (let k = 0; k < 3; k++) {
      positions[i + k] = m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k];
      normals[i + k] = m[k] * a + m[4 + k] * b + m[8 + k] * c;
    }
  }
  const colors = new Uint8Array((4 * positions.length) / 3).fill(255);
  if (_CONFIDENCE !== undefined && _VIEWS !== undefined) {
    const [confidence, views] = [_CONFIDENCE, _VIEWS].map((index) => values(index, FLOAT, Float32Array));
    for (let i = 0; i < confidence.length; i++) colors[4 * i + 3] = Math.max(Math.round(255 * confidence[i]), views[i] > 0 ? 1 : 0);
  }
  const faces = values(primitive.indices, UINT, Uint32Array);
  const image = root.images[0];
  return { positions, normals, uvs, colors, faces, texture: new Blob([bytesOf(image.bufferView)], { type: image.mimeType }) };
}
