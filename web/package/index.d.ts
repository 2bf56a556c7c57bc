/** Why WebGPU cannot be used here; `undefined` if it can. */
export function missing(): Promise<string | undefined>;

/** Loads the engine, once; viewers do that themselves when they need it. */
export function preload(): Promise<unknown>;

/** What a lone archive is shown on. */
export type Shape = "plane" | "sphere" | "cylinder" | "cloth";

/** What `command` takes; the keys of the same name do the same. */
export type Command =
  | "toggle-mode" | "reset" | "next-shape" | "next-overlay" | "previous-overlay" | "brighter" | "darker" | "next-light" | "add-light" | "remove-light"
  | "record" | "replay" | "turntable" | "retry";

/** Milliseconds of one frame by phase. */
export interface Milliseconds {
  votes: number;
  residency: number;
  source: number;
  decode: number;
  upload: number;
  draw: number;
  /** By pass, where the adapter can tell. */
  gpu: Record<string, number> | null;
}

/** What the last frame did. */
export interface FrameStats {
  frame: number;
  archives: number;
  archives_known: number;
  archives_failed: number;
  pages_wanted: number;
  pages_resident: number;
  columns_resident: number;
  added: number;
  swapped: number;
  /** Pages and columns that are asked for and not placed. */
  in_flight: number;
  texels_stitched: number;
  wire_bytes: number;
  wire_bytes_total: number;
  gpu_bytes: number;
  host_bytes: number;
  /** Root mean square reflectance error against everything resident. */
  predicted_rms: number;
  format_rms: number;
  settled: boolean;
  drawn: boolean;
  ms: Milliseconds;
}

/** Figures. */
export interface Report {
  frame: FrameStats;
  /** Work that was not needed, and work that went wrong, since the start. */
  counters: Record<string, number>;
  /** What was asked of the source, and what it took. */
  source: Record<string, number>;
  /** Where the records come from. */
  origin: string;
  connection: { state: "fine" | "waiting" } | { state: "lost"; message: string };
  materials: {
    name: string;
    state: "unknown" | "loading" | "shown" | "settled" | "failed";
    failure?: string;
    wire_bytes: number;
    pages_resident: number;
    /** Of its error, the part that is gone; `null` where it is not in view. */
    progress: number | null;
  }[];
  problems: string[];
  /** There was a first picture. */
  shown: boolean;
  adapter: string;
  /** Pixels. */
  size: [number, number];
  /** Requests that were started, and those that were given up. */
  gets: { started: number; aborted: number };
  /** Bytes that are kept for the next visit. */
  kept_bytes: number;
}

/** `detail` of `progress`, `firstpicture` and `settled`. */
export interface Progress extends Report {
  /** From 0 to 1, by the predicted error. */
  progress: number;
}

export interface EigentileViewerEventMap extends Omit<HTMLElementEventMap, "progress" | "error"> {
  /** The scene is there; pictures follow. */
  open: CustomEvent<null>;
  firstpicture: CustomEvent<Progress>;
  /** Four times a second, while anything changes. */
  progress: CustomEvent<Progress>;
  /** The picture is as good as it gets. */
  settled: CustomEvent<Progress>;
  /** The new link. */
  linkchange: CustomEvent<string>;
  connectionlost: CustomEvent<null>;
  connected: CustomEvent<null>;
  /** Why there is no WebGPU. */
  unsupported: CustomEvent<string>;
  /** Something that was set could not be: why. */
  problem: CustomEvent<string>;
  /** A key that is the page's: `panel`, `split`, … */
  command: CustomEvent<string>;
}

/** `<eigentile-viewer src="…">`. An event `error`, whose `detail` is a string, tells that nothing can be shown. */
export class EigentileViewer extends HTMLElement {
  src: string;
  link: string;
  exposure: number;
  get shape(): Shape | undefined;
  set shape(name: Shape | undefined);
  /** What lies over the picture: the name of one of `overlays`. */
  overlay: string;
  readonly overlays: { name: string; title: string; legend: { label: string; colour: string }[] }[];
  cacheBytes: number;
  readonly settled: boolean;
  readonly problem: string | undefined;
  readonly report: Report | undefined;
  command(name: Command): boolean;
  retry(): void;
  picture(): Promise<Blob>;
  save(name?: string): Promise<void>;
  addEventListener<K extends keyof EigentileViewerEventMap>(
    type: K, listener: (this: EigentileViewer, event: EigentileViewerEventMap[K]) => unknown,
    options?: boolean | AddEventListenerOptions): void;
  addEventListener(
    type: string, listener: EventListenerOrEventListenerObject, options?: boolean | AddEventListenerOptions): void;
}

declare global {
  interface HTMLElementTagNameMap {
    "eigentile-viewer": EigentileViewer;
  }
}
