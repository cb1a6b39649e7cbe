// Runs the module without imports, and holds its hashes against those of the native program.
//
//     node tools/browser/run.mjs BROWSER.wasm NATIVE
//
// BROWSER.wasm: cargo build --release --manifest-path tools/browser/Cargo.toml --target wasm32-unknown-unknown --lib
// NATIVE: cargo build --release --manifest-path tools/browser/Cargo.toml --bin native
import { spawnSync } from "node:child_process";
import { readFileSync } from "node:fs";

const [wasm, native] = process.argv.slice(2);
if (!native) {
    console.error("usage: node run.mjs BROWSER.wasm NATIVE");
    process.exit(2);
}
const expected = spawnSync(native, { encoding: "utf8" }).stdout.trim().split("\n");
const { instance } = await WebAssembly.instantiate(readFileSync(wasm), {});
let wrong = 0;
for (const [certified, hash] of expected.entries()) {
    const ours = BigInt.asUintN(64, instance.exports.hash(certified, 90)).toString(16).padStart(16, "0");
    const name = certified ? "certified" : "real-time preset";
    console.log(`browser: ${name}: ${ours === hash ? "90 steps with the same bits" : `${ours}, not ${hash}`}`);
    wrong += Number(ours !== hash || /^0+$/.test(ours));
}
process.exit(wrong ? 1 : 0);
