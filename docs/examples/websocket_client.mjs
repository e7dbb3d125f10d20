// Go to the middle of the reach over the page's WebSocket, and print the measured position.
//
// Start `dehyst run` and `dehyst page`, then with Node 22 or later (20: --experimental-websocket), or in
// a browser: node docs/examples/websocket_client.mjs [ws://127.0.0.1:8080/stream]

const address = process.argv[2] ?? "ws://127.0.0.1:8080/stream";
const socket = new WebSocket(address);
socket.binaryType = "arraybuffer";
let chosen = null;
let asked = false;
const ask = (what) => socket.send(JSON.stringify(what));

socket.onmessage = ({ data }) => {
  if (typeof data !== "string") return; // plots
  const message = JSON.parse(data);
  if (message.kind === "controllers") {
    if (message.protocol !== 1) throw new Error(`protocol ${message.protocol} is not spoken here`);
    if (chosen === null && message.names.length > 0) {
      chosen = message.names[0];
      ask({ ask: "look", name: chosen, window_s: 10, width_px: 100 });
    }
  } else if (message.kind === "status" && message.status !== null) {
    const { reach_min: low, reach_max: high, unit } = message.status;
    const middle = 0.5 * (low + high);
    if (!asked) {
      asked = true;
      ask({ ask: "go", value: middle, seconds: 5 });
    } else if (message.target !== null && Math.abs(message.target - middle) < 1e-9) {
      console.log(`target ${message.target.toFixed(3)} ${unit}, measured ${message.measured}`);
      ask({ ask: "stop", at_once: false });
      setTimeout(() => socket.close(), 200);
    }
  } else if (message.kind === "said" && message.wrong) {
    console.error(message.text);
    socket.close();
  }
};
socket.onerror = () => {
  console.error(`${address}: no page answers; start \`dehyst page\``);
  process.exitCode = 1;
};
