// The Khronos validator's verdict. Usage: node validate_glb.mjs NODE_MODULES FILE.glb; prints its `issues` as JSON.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

const [modules, file] = process.argv.slice(2);
const validator = createRequire(import.meta.url)(join(resolve(modules), "gltf-validator"));
const report = await validator.validateBytes(new Uint8Array(readFileSync(file)));
console.log(JSON.stringify({ issues: report.issues, info: report.info }));
