// Pictures of a GLB or a USDZ by three.js in Chromium, from the cameras of OUT/ours/ORBIT/transforms.json, in OUT/FOLDER.
//
//     node three_render.mjs MODULES CHROMIUM MESH OUT FOLDER ORBIT...

import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { extname, join, normalize } from 'node:path';

const [modules, executablePath, mesh, out, folder, ...orbits] = process.argv.slice(2);
const { chromium } = createRequire(`${modules}/`)('playwright-core');

const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.glb': 'model/gltf-binary' };

/** Where the page finds the mesh: its ending says what it is. */
const served = `/mesh${extname(mesh)}`;

/** The file of a path of the page: the page, the mesh, or a module of three.js. */
function fileOf(path) {
  if (path === '/') return join(import.meta.dirname ?? new URL('.', import.meta.url).pathname, 'page.html');
  if (path === served) return mesh;
  return join(modules, 'node_modules', normalize(path));
}

const server = createServer((request, response) => {
  if (request.url === '/favicon.ico') return response.writeHead(204).end();
  try {
    const file = fileOf(new URL(request.url, 'http://localhost').pathname);
    const body = readFileSync(file);
    response.writeHead(200, { 'content-type': TYPES[extname(file)] ?? 'application/octet-stream' }).end(body);
  } catch {
    response.writeHead(404).end();
  }
});
await new Promise((done) => server.listen(0, '127.0.0.1', done));

const browser = await chromium.launch({
  executablePath,
  args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'],
});
try {
  const page = await browser.newPage();
  page.on('pageerror', (error) => console.error(`three.js: ${error}`));
  page.on('console', (message) => message.type() === 'error' && console.error(`three.js: ${message.text()}`));
  await page.goto(`http://127.0.0.1:${server.address().port}/?mesh=${served}`);
  await page.waitForFunction('window.isReady === true', undefined, { timeout: 120_000 });
  mkdirSync(join(out, folder), { recursive: true });
  writeFileSync(join(out, folder, 'scene.json'), JSON.stringify(await page.evaluate('described()'), null, 2));
  for (const orbit of orbits) {
    const pictures = join(out, folder, orbit);
    mkdirSync(pictures, { recursive: true });
    const { frames } = JSON.parse(readFileSync(join(out, 'ours', orbit, 'transforms.json')));
    for (const frame of frames) {
      const png = await page.evaluate((frame) => window.pictured(frame), frame);
      writeFileSync(join(pictures, frame.file_path), Buffer.from(png, 'base64'));
    }
  }
} finally {
  await browser.close();
  server.close();
}
