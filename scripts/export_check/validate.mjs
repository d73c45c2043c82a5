// Khronos' glTF-Validator, of which every message counts, and what the file says of itself.
//
//     node validate.mjs MODULES MESH.glb REPORT.json

import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename } from 'node:path';

const [modules, mesh, reportFile] = process.argv.slice(2);
const validator = createRequire(`${modules}/`)('gltf-validator');

const bytes = new Uint8Array(readFileSync(mesh));
const report = await validator.validateBytes(bytes, { uri: basename(mesh), maxIssues: 0 });
writeFileSync(reportFile, JSON.stringify(report, null, 2));

const problems = report.issues.messages.map(({ code, message, pointer, severity }) => {
  const kind = ['error', 'warning', 'information', 'hint'][severity];
  return `${kind} ${code} at ${pointer}: ${message}`;
});

const text = new TextDecoder().decode(bytes.subarray(20, 20 + new DataView(bytes.buffer).getUint32(12, true)));
const gltf = JSON.parse(text);
if (gltf.asset.version !== '2.0') problems.push(`the version of glTF is ${gltf.asset.version}, not 2.0`);
if (!/^dvr \d+\.\d+\.\d+/.test(gltf.asset.generator ?? '')) {
  problems.push(`the generator is ${gltf.asset.generator}, not dvr with its version`);
}
for (const kind of ['nodes', 'meshes', 'materials', 'images']) {
  const nameless = (gltf[kind] ?? []).filter((item) => !item.name);
  if (nameless.length > 0) problems.push(`${nameless.length} of the ${kind} have no name`);
}

const shown = problems.slice(0, 20);
for (const problem of shown) console.log(`FAILED validator: ${problem}`);
if (problems.length > shown.length) console.log(`FAILED validator: ... and ${problems.length - shown.length} more`);
if (problems.length === 0) {
  const { validatorVersion, info } = report;
  console.log(
    `ok validator ${validatorVersion}: no message; glTF ${gltf.asset.version} by ${gltf.asset.generator}, ` +
      `${info.totalVertexCount} vertices, ${info.totalTriangleCount} triangles`,
  );
}
process.exitCode = problems.length === 0 ? 0 : 1;
