// three.js with urdf-loader, in Node with a stand-in for the browser's XML parser: the force point at bent wings.
import { readFileSync } from "node:fs";
import { JSDOM } from "jsdom";

const { window } = new JSDOM("");
Object.assign(globalThis, { DOMParser: window.DOMParser, Document: window.Document, Element: window.Element });
const { default: URDFLoader } = await import("urdf-loader");
const reference = JSON.parse(readFileSync(process.argv[2], "utf8"));
let worst = 0, meshes = 0;
for (const [name, said] of Object.entries(reference)) {
  const loader = new URDFLoader();
  loader.loadMeshCb = (path, ...rest) => { meshes += path.endsWith(".stl"); rest.at(-1)(null); };
  const robot = loader.parse(readFileSync(`${process.argv[3]}/urdf/${name}.urdf`, "utf8"));
  for (const state of said.states) {
    said.joints.forEach((joint, k) => robot.setJointValue(joint, state.angles[k]));
    robot.updateMatrixWorld(true);
    for (const [frame, place] of Object.entries(state.places)) {
      const found = robot.frames[frame].matrixWorld.elements;
      place.forEach((row, i) => row.forEach((value, j) => { worst = Math.max(worst, Math.abs(value - found[4 * j + i])); }));
    }
  }
}
if (!(worst < 1e-9 && meshes > 0)) throw new Error(`off by ${worst}, ${meshes} meshes`);
console.log(`found: wings and force point where Pinocchio has them, to ${worst.toExponential(0)}; ${meshes} meshes asked for`);
