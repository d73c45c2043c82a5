// Pictures of a GLB by three.js in Chromium, from the cameras of OUT/ours/ORBIT/transforms.json.
//
//     node three_render.mjs MODULES CHROMIUM MESH.glb OUT ORBIT...

import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { extname, join, normalize } from 'node:path';

const [modules, executablePath, mesh, out, ...orbits] = process.argv.slice(2);
const { chromium } = createRequire(`${modules}/`)('playwright-core');

const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.glb': 'model/gltf-binary' };

/** The file of a path of the page: the page, the mesh, or a module of three.js. */
function fileOf(path) {
  if (path === '/') return join(import.meta.dirname ?? new URL('.', import.meta.url).pathname, 'page.html');
  if (path === '/mesh.glb') return mesh;
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
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  await page.waitForFunction('window.isReady === true', undefined, { timeout: 120_000 });
  mkdirSync(join(out, 'three'), { recursive: true });
  writeFileSync(join(out, 'three/scene.json'), JSON.stringify(await page.evaluate('described()'), null, 2));
  for (const orbit of orbits) {
    const folder = join(out, 'three', orbit);
    mkdirSync(folder, { recursive: true });
    const { frames } = JSON.parse(readFileSync(join(out, 'ours', orbit, 'transforms.json')));
    for (const frame of frames) {
      const png = await page.evaluate((frame) => window.pictured(frame), frame);
      writeFileSync(join(folder, frame.file_path), Buffer.from(png, 'base64'));
    }
  }
} finally {
  await browser.close();
  server.close();
}
