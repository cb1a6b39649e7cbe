// Runs scenes in the module without imports, and holds its hashes against those of the native
// program.
//
//     node tools/browser/run.mjs BROWSER.wasm NATIVE STEPS SCENE...
//
// BROWSER.wasm: cargo build --release --manifest-path tools/browser/Cargo.toml --target wasm32-unknown-unknown --lib
// NATIVE: cargo build --release --manifest-path tools/browser/Cargo.toml --bin native
// SCENE: in TOML or JSON
import { spawnSync } from "node:child_process";
import { readFileSync } from "node:fs";

const [wasm, native, steps, ...scenes] = process.argv.slice(2);
if (scenes.length === 0) {
    console.error("usage: node run.mjs BROWSER.wasm NATIVE STEPS SCENE...");
    process.exit(2);
}
const run = spawnSync(native, [steps, ...scenes], { encoding: "utf8" });
const expected = run.stdout.trim().split("\n");
if (run.status !== 0 || expected.length !== 2 * scenes.length) {
    console.error(`browser: the native program failed: ${run.stderr}`);
    process.exit(1);
}
const { instance } = await WebAssembly.instantiate(readFileSync(wasm), {});
const { hash, memory, refuses_files, reserve } = instance.exports;
let wrong = Number(!refuses_files());
console.log(`browser: files are ${wrong ? "not " : ""}refused without a panic`);
for (const [i, scene] of scenes.entries()) {
    for (const certified of [0, 1]) {
        const text = readFileSync(scene);
        // The address first: memory grows.
        const place = reserve(text.length);
        new Uint8Array(memory.buffer, place, text.length).set(text);
        const ours = BigInt.asUintN(64, hash(certified, Number(steps))).toString(16).padStart(16, "0");
        const theirs = expected[2 * i + certified];
        const same = ours === theirs && !/^0+$/.test(ours);
        const preset = certified ? "certified" : "real-time preset";
        console.log(`browser: ${scene}, ${preset}: ${same ? `the same bits after ${steps} steps` : `${ours}, not ${theirs}`}`);
        wrong += Number(!same);
    }
}
process.exit(wrong ? 1 : 0);
