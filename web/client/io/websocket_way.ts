// What a session travels by, and the first of two: a websocket of the page's own origin.

/** What `onClose` says if a broker wants a login. */
export const REFUSED_LOGIN = "login refused";

export interface Way {
  onOpen: () => void;
  onMessage: (data: Uint8Array) => void;
  /** It is over, by the other end or the network, whose word is `reason`. */
  onClose: (reason: string) => void;
  readonly isOpen: boolean;
  /** Send now, or lose it: a joystick's command that arrives late is worse than none. */
  send(data: Uint8Array, topic: string): void;
  /** On a broker: hear these topics below the root, and no others. */
  hear(topics: readonly string[]): void;
  /** Nothing is told afterwards. */
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
    // There are no topics.
  }

  close(): void {
    this.#socket.close();
  }
}
