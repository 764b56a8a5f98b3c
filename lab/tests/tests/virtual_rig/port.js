// A serial port of the browser's that is a socket of this computer: a virtual rig is at its end.
(() => {
  const address = "ws://127.0.0.1:PORT";
  class Port extends EventTarget {
    readable = null;
    writable = null;
    async open() {
      if (this.socket) throw new DOMException("The port is already open.", "InvalidStateError");
      const socket = new WebSocket(address);
      socket.binaryType = "arraybuffer";
      await new Promise((resolve, reject) => {
        socket.onopen = resolve;
        socket.onclose = () => reject(new DOMException("Failed to open serial port.", "NetworkError"));
      });
      this.socket = socket;
      this.readable = new ReadableStream({
        start: (stream) => {
          socket.onmessage = ({ data }) => stream.enqueue(new Uint8Array(data));
          socket.onclose = () => {
            this.readable = null;
            this.socket = null;
            try { stream.error(new DOMException("The device has been lost.", "NetworkError")); } catch { /* it is closed */ }
          };
        },
        cancel: () => { this.readable = null; },
      });
      this.writable = new WritableStream({ write: (bytes) => socket.send(bytes) });
    }
    async setSignals() {}
    async close() {
      const { socket } = this;
      this.socket = this.readable = this.writable = null;
      if (!socket) return;
      await new Promise((resolve) => { socket.onclose = resolve; socket.close(); });
    }
  }
  const serial = new EventTarget();
  serial.requestPort = async () => new Port();
  Object.defineProperty(Navigator.prototype, "serial", { configurable: true, get: () => serial });
})();
