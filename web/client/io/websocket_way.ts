// The interface of a session's transports, and the first of two: a websocket of the page's own origin.

/** The reason in `onClose` if a broker requires a login. */
export const REFUSED_LOGIN = "login refused";

export interface Way {
  onOpen: () => void;
  onMessage: (data: Uint8Array) => void;
  /** The connection has ended; `reason` comes from the other end or the network. */
  onClose: (reason: string) => void;
  readonly isOpen: boolean;
  /** Send now, or drop it: a late joystick command is worse than none. */
  send(data: Uint8Array, topic: string): void;
  /** On a broker: subscribe to these topics below the root only. */
  hear(topics: readonly string[]): void;
  /** No events follow. */
  close(): void;
}

export class WebsocketWay implements Way {
  onOpen = (): void => {};
  onMessage: Way["onMessage"] = () => {};
  onClose: Way["onClose"] = () => {};
  readonly #socket: WebSocket;

  constructor(url: string) {
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.onOpen();
    socket.onmessage = ({ data }: MessageEvent) => {
      if (data instanceof ArrayBuffer) this.onMessage(new Uint8Array(data));
    };
    socket.onclose = ({ reason }: CloseEvent) => this.onClose(reason);
    this.#socket = socket;
  }

  get isOpen(): boolean {
    return this.#socket.readyState === WebSocket.OPEN;
  }

  /** Closed, or closing. */
  get isOver(): boolean {
    return this.#socket.readyState >= WebSocket.CLOSING;
  }

  send(data: Uint8Array): void {
    if (this.isOpen) this.#socket.send(data as Uint8Array<ArrayBuffer>);
  }

  hear(): void {
    // A websocket has no topics.
  }

  close(): void {
    this.#socket.close();
  }
}
