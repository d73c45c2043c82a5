// Reads what dvr-report's mesh_data.rs writes.
"use strict";

async function inflated(text) {
  const raw = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Positions, normals and texture coordinates as floats, colours, confidence and views as bytes, faces as indices.
async function decodeMesh(text, facts) {
  const bytes = await inflated(text);
  const n = facts.vertices;
  const positions = new Float32Array(3 * n);
  // Tells the shares, from 0 to 1, whose low bytes are a plane and whose high bytes are the next.
  const shares = (plane, tell) => {
    for (let i = 0, value = 0; i < n; i++) {
      const code = bytes[plane * n + i] | (bytes[(plane + 1) * n + i] << 8);
      value = (value + ((code >> 1) ^ -(code & 1))) & 0xffff;
      tell(i, value / 65535);
    }
  };
  for (let axis = 0; axis < 3; axis++) {
    const [low, extent] = [facts.low[axis], facts.high[axis] - facts.low[axis]];
    shares(2 * axis, (i, share) => { positions[3 * i + axis] = low + extent * share; });
  }
  const component = (index) => {
    const values = new Uint8Array(n);
    for (let i = 0, value = 0; i < n; i++) {
      const code = bytes[index * n + i];
      values[i] = value = (value + ((code >> 1) ^ -(code & 1))) & 0xff;
    }
    return values;
  };
  const [u, v] = [component(6), component(7)];
  const normals = new Float32Array(3 * n);
  for (let i = 0; i < n; i++) {
    let [x, y] = [u[i] / 127.5 - 1, v[i] / 127.5 - 1];
    const z = 1 - Math.abs(x) - Math.abs(y);
    if (z < 0) {
      [x, y] = [(1 - Math.abs(y)) * (x >= 0 ? 1 : -1), (1 - Math.abs(x)) * (y >= 0 ? 1 : -1)];
    }
    const length = Math.hypot(x, y, z) || 1;
    normals.set([x / length, y / length, z / length], 3 * i);
  }
  const channels = [component(8), component(9), component(10), component(11)];
  const views = component(12);
  const colors = new Uint8Array(4 * n);
  for (let c = 0; c < 4; c++) {
    for (let i = 0; i < n; i++) colors[4 * i + c] = channels[c][i];
  }
  const uvs = facts.textured ? new Float32Array(2 * n) : null;
  for (let axis = 0; uvs && axis < 2; axis++) shares(13 + 2 * axis, (i, share) => { uvs[2 * i + axis] = share; });
  const faces = new Uint32Array(3 * facts.faces);
  for (let i = 0, at = (uvs ? 17 : 13) * n, next = 0; i < faces.length; i++) {
    let code = 0;
    for (let shift = 0; ; shift += 7) {
      const byte = bytes[at++];
      code |= (byte & 0x7f) << shift;
      if (byte < 0x80) break;
    }
    faces[i] = next - code;
    if (code === 0) next++;
  }
  return { positions, normals, uvs, colors, views, faces };
}
