// A Modbus slave by modbus-serial (npm) over TCP: modbus_slave.js tcp PORT
// The same registers as modbus_slave.py.
const { ServerTCP } = require("modbus-serial");

let requests = 0;
const bytes = Buffer.alloc(10);
function register(address) {
  if (address < 100 || address > 104) throw { modbusErrorCode: 2 };
  if (address === 100) {
    ++requests;
    bytes.writeUInt32BE(requests, 0);
    bytes.writeInt16BE(requests % 30000, 4);
    bytes.writeFloatBE(requests, 6);
  }
  return bytes.readUInt16BE(2 * (address - 100));
}
const server = new ServerTCP({ getHoldingRegister: register },
  { host: "127.0.0.1", port: Number(process.argv[3]), unitID: 1 });
server.on("initialized", () => console.log("serving"));
server.on("socketError", () => {});
