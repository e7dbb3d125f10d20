"""A controller on a socket that speaks a minimum of PI's General Command Set."""

import socketserver
import threading


class GcsUnit(socketserver.ThreadingTCPServer):
    """One axis, "1": volts (SVA) and a position of 0.1 um per volt (POS)."""

    allow_reuse_address = daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Connection)
        self.volts, self.error = 12.0, 0
        self.port = self.server_address[1]
        self._thread = threading.Thread(target=self.serve_forever, args=(0.01,))
        self._thread.start()

    def stop(self) -> None:
        """End the server."""
        self.shutdown()
        self.server_close()
        self._thread.join()

    def answer(self, line: str) -> str:
        """Return the reply to a command, or "" if there is none."""
        match line.split():
            case ["*IDN?"]:
                return "(c)2013 Physik Instrumente(PI) Karlsruhe, E-709.CHG, 113012345, 1.2.3\n"
            case ["ERR?"]:
                error, self.error = self.error, 0
                return f"{error}\n"
            case ["SVA?", "1"]:
                return f"1={self.volts:.6f}\n"
            case ["POS?", "1"]:
                return f"1={0.1 * self.volts:.6f}\n"
            case ["SVA", "1", volts]:
                self.volts = float(volts)
            case _:
                self.error = 2  # unknown command
        return ""


class _Connection(socketserver.StreamRequestHandler):
    server: GcsUnit

    def handle(self) -> None:
        for line in self.rfile:
            self.wfile.write(self.server.answer(line.decode().strip()).encode())
