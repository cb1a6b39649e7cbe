// Runs the scenes as WebAssembly and holds the hash of every step against those of a native bake.
//
//     node tools/golden/run.mjs GOLDEN.wasm DRYSTONE STEPS SCENE...
//
// GOLDEN.wasm: cargo build --release --manifest-path tools/golden/Cargo.toml --target wasm32-wasip1
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, dirname, join, resolve } from "node:path";

const [wasm, drystone, steps, ...scenes] = process.argv.slice(2);
if (scenes.length === 0) {
    console.error("usage: node run.mjs GOLDEN.wasm DRYSTONE STEPS SCENE...");
    process.exit(2);
}

/** What a program prints; ends this one if it fails. */
function output(program, ...options) {
    const ended = spawnSync(program, options, { encoding: "utf8", maxBuffer: 1 << 28 });
    if (ended.status !== 0) {
        console.error(`${program} ${options.join(" ")}\n${ended.stderr}`);
        process.exit(1);
    }
    return ended.stdout;
}

const host = `
const { WASI } = require("node:wasi");
const [file, folder, ...options] = process.argv.slice(1);
const wasi = new WASI({ version: "preview1", args: ["golden", ...options], preopens: { "/scenes": folder } });
const program = new WebAssembly.Module(require("node:fs").readFileSync(file));
process.exitCode = wasi.start(new WebAssembly.Instance(program, wasi.getImportObject())) ?? 0;
`;
const folder = mkdtempSync(join(tmpdir(), "golden-"));
let wrong = 0;
for (const scene of scenes) {
    const report = join(folder, "report.json");
    output(drystone, "bake", scene, "--steps", steps, "--threads", "1", "-q", "--report", report);
    const native = JSON.parse(readFileSync(report)).per_step.map(step => step.state);
    const place = `/scenes/${basename(scene)}`;
    const printed = output(process.execPath, "--no-warnings", "-e", host, wasm, dirname(resolve(scene)), steps, place);
    const ours = printed.trim().split("\n").map(line => line.split(" ")[2]);
    const first = native.findIndex((hash, step) => hash !== ours[step]);
    const same = first < 0 && ours.length === native.length;
    console.log(`golden: ${scene}: ${same ? `${steps} steps with the same bits` : `step ${first + 1} is another`}`);
    wrong += same ? 0 : 1;
}
rmSync(folder, { recursive: true });
process.exit(wrong ? 1 : 0);
