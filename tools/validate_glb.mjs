// Bakes a second of scenes and holds each .glb against Khronos' glTF validator.
//
//     npm install --prefix out/npm gltf-validator@2.0.0-dev.3.10
//     node tools/validate_glb.mjs out/npm DRYSTONE SCENE...
//
// A SCENE may be a folder: then all glTF in it that DRYSTONE accepts. What the validator says of a glTF
// scene already, it may say of the bake as well. Prints what is new in each; exit code 1 where that is an
// error, or where nothing was baked.

import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, readdirSync, rmSync, statSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { basename, dirname, join, resolve } from "node:path";

const [modules, drystone, ...named] = process.argv.slice(2);
const validator = createRequire(resolve(modules, "node_modules/"))("gltf-validator");

/** Severities of the validator. */
const ERROR = 0;
const WARNING = 1;

/** Scenes and all glTF of folders. */
function* scenes(names) {
    for (const name of names) {
        if (!statSync(name).isDirectory()) {
            yield name;
            continue;
        }
        for (const file of readdirSync(name, { recursive: true }).sort()) {
            if (/\.(gltf|glb)$/i.test(file) && statSync(join(name, file)).isFile()) yield join(name, file);
        }
    }
}

/** What the validator finds in a file: errors and warnings. */
async function issues(file) {
    const beside = uri => readFileSync(join(dirname(file), decodeURIComponent(uri)));
    const options = { maxIssues: 10000, externalResourceFunction: async uri => new Uint8Array(beside(uri)) };
    const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), options);
    return report.issues.messages.filter(issue => issue.severity <= WARNING);
}

const same = (a, b) => a.code === b.code && (a.pointer === b.pointer || a.message === b.message);

const folder = mkdtempSync(join(tmpdir(), "drystone-"));
const total = { baked: 0, refused: 0, errors: 0, warnings: 0, before: 0 };
for (const scene of scenes(named)) {
    const baked = join(folder, `${basename(scene)}.glb`);
    const bake = ["bake", scene, "--duration", "1", "--fps", "24", "--realtime", "-q", "-o", baked];
    const { status, stderr } = spawnSync(drystone, bake, { encoding: "utf8" });
    // Of a folder, some are meant to be wrong.
    if (status !== 0) {
        const meant = !named.includes(scene) && status === 2;
        if (!meant) console.log(`${scene}: exit code ${status}: ${stderr.trim()}`);
        total.errors += meant ? 0 : 1;
        total.refused += 1;
        continue;
    }
    const known = /\.(gltf|glb)$/i.test(scene) ? await issues(scene) : [];
    const found = await issues(baked);
    const fresh = found.filter(issue => !known.some(old => same(issue, old)));
    const errors = fresh.filter(issue => issue.severity === ERROR).length;
    total.baked += 1;
    total.errors += errors;
    total.warnings += fresh.length - errors;
    const before = found.length - fresh.length;
    total.before += before > 0 ? 1 : 0;
    const also = before > 0 ? `; ${before} that the scene had before` : "";
    console.log(`${scene}: ${errors} errors, ${fresh.length - errors} warnings${also}`);
    for (const { code, pointer, message } of fresh) console.log(`  ${code} at ${pointer}: ${message}`);
    for (const issue of found.filter(issue => !fresh.includes(issue))) {
        console.log(`  before: ${issue.code} at ${issue.pointer}`);
    }
}
rmSync(folder, { recursive: true });
const { baked, refused, errors, warnings, before } = total;
console.log(`${baked} baked, ${refused} refused: ${errors} errors, ${warnings} warnings; ${before} with older ones`);
process.exit(errors > 0 || baked === 0 ? 1 : 0);
