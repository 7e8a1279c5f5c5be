// Decodes the golden and conformance files with the module of WebAssembly, and compares with what is expected of them.
// node run.mjs MODULE.wasm GOLDEN CONFORMANCE
import { readFileSync, readdirSync } from "node:fs";
import { join } from "node:path";

const [modulePath, golden, conformance] = process.argv.slice(2);
const compiled = new WebAssembly.Module(readFileSync(modulePath));

function decoded(path) {
    // A trap leaves an instance as it is: each file gets its own.
    const { memory, alloc, decode, result } = new WebAssembly.Instance(compiled).exports;
    const file = readFileSync(path);
    try {
        // Each call may move the memory's buffer.
        const at = alloc(file.length);
        new Uint8Array(memory.buffer, at, file.length).set(file);
        const length = decode();
        return new TextDecoder().decode(new Uint8Array(memory.buffer, result(), length));
    } catch (error) {
        return `${error}\n`;
    }
}

const cases = [];
for (const line of readFileSync(join(golden, "list.txt"), "utf8").split("\n").filter((line) => line)) {
    const name = line.slice(0, line.indexOf(":"));
    const last = decoded(join(golden, `${name}.lods`)).trimEnd().split("\n").pop();
    cases.push([name, line, last.replace(/^all:/, `${name}:`)]);
}
for (const file of readdirSync(conformance).filter((file) => file.endsWith(".lods"))) {
    const expected = readFileSync(join(conformance, file.replace(/lods$/, "expected")), "utf8");
    cases.push([file, expected, decoded(join(conformance, file))]);
}
const wrong = cases.filter(([, expected, found]) => expected !== found);
wrong.forEach(([name, expected, found]) => console.error(`${name}: expected\n${expected}\nfound\n${found}`));
console.log(`wasm32: ${cases.length - wrong.length} of ${cases.length} files decode as they should`);
process.exit(wrong.length > 0 || cases.length < 40 ? 1 : 0);
