// Bundles viewer.js with the parts of three.js that it uses into viewer.min.js. Run it by `cargo xtask viewer`.
//
// The first line of the bundle has the SHA-256 of its sources, one after the other in the order below, and of all that
// follows that line; a test compares both.

import { createHash } from 'node:crypto';
import { readFileSync, writeFileSync } from 'node:fs';
import { build } from 'esbuild';

const SOURCES = ['viewer.js', 'build.mjs', 'package.json', 'package-lock.json'];

const read = (name) => readFileSync(new URL(name, import.meta.url), 'utf8').replaceAll('\r\n', '\n');
const sha256 = (text) => createHash('sha256').update(text).digest('hex');

// Every page is a copy of three.js and so has to carry its licence.
const licence = readFileSync(new URL('node_modules/three/LICENSE', import.meta.url), 'utf8').replaceAll('©', '(c)');
const { version } = JSON.parse(read('node_modules/three/package.json'));
writeFileSync(new URL('three-LICENSE', import.meta.url), licence);

const { outputFiles } = await build({
  entryPoints: ['viewer.js'],
  absWorkingDir: new URL('.', import.meta.url).pathname,
  bundle: true,
  minify: true,
  write: false,
  format: 'iife',
  target: ['es2020'],
  charset: 'ascii',
  legalComments: 'none',
  banner: { js: `/*! Contains parts of three.js ${version}:\n\n${licence.trim()}\n*/` },
});
const bundle = outputFiles[0].text;
const head = `/* isochor viewer, sources ${sha256(SOURCES.map(read).join(''))}, bundle ${sha256(bundle)} */\n`;
writeFileSync(new URL('viewer.min.js', import.meta.url), head + bundle);
console.log(`viewer.min.js: ${(head.length + bundle.length) / 1000} kB`);
