// Enable, close until something is held while watching, and leave: the daemon keeps holding.
// node grasp.js /run/litegripd/can0.sock
const socket = require("node:net").connect(process.argv[2]);
const waiting = new Map(); // the requests without an answer, by id
let lastId = 0;
let rest = "";

function call(method, params = {}) {
  const id = ++lastId;
  socket.write(JSON.stringify({ jsonrpc: "2.0", id, method, params }) + "\n");
  return new Promise((resolve, reject) => waiting.set(id, { resolve, reject }));
}

function handle(message) {
  if (message.method === "state.sample") {
    console.log("opening", message.params.state.opening_mm, "mm");
  } else if (waiting.has(message.id)) {
    const { resolve, reject } = waiting.get(message.id);
    waiting.delete(message.id);
    message.error ? reject(message.error) : resolve(message.result);
  }
}

function fail(error) {
  console.error(error.message, error.data?.reason ?? "");
  process.exit(1);
}

socket.setEncoding("utf8").on("error", fail).on("data", (chunk) => {
  const lines = (rest + chunk).split("\n");
  rest = lines.pop(); // a line may come in pieces
  lines.map((line) => JSON.parse(line)).forEach(handle);
});

async function main() {
  await call("state.subscribe", { hz: 10, fields: ["opening_mm"] });
  await call("motor.enable");
  const result = await call("motion.grasp", { force_n: 10, until: "verdict" });
  console.log(result.outcome, result.width_mm);
  socket.destroy();
}

main().catch(fail);
