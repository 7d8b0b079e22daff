// The turntable before and after its scene is there: three.js is most of the page, and comes last.

const WAIT_MS = 1000; // for plots; without any it is loaded all the same

export class Turntable {
  constructor() {
    this.latest = new Map(); // calls that the scene has yet to hear of
    this.scene = null;
    this.isAsked = false;
    setTimeout(() => this.load(), WAIT_MS);
  }

  async load() {
    if (this.isAsked) return;
    this.isAsked = true;
    const { Scene } = await import("./scene.js");
    this.scene = new Scene();
    for (const [name, what] of this.latest) this.scene[name](what);
  }

  call(name, what) {
    if (this.scene) this.scene[name](what);
    else this.latest.set(name, what);
  }

  setGeometry(gyros, accelerometers) {
    this.call("setGeometry", { gyros, accelerometers });
  }

  setStates(states) {
    this.call("setStates", states);
  }

  setPose(pose) {
    this.call("setPose", pose);
  }

  restyle() {
    this.scene?.build();
  }

  resetView() {
    this.scene?.resetView();
  }

  draw() {
    this.scene?.draw();
  }
}
