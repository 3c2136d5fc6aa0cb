// The mission editor: draw landmarks and ways on the building's map, compile, audit, send.

import { useEffect, useMemo, useReducer, useState } from "react";
import { operator as texts } from "../../texts";
import type { RunningMission } from "../gateway_state";
import type { Station } from "../station";
import { type Compiled, Desk, type Job, Trouble, type World } from "./desk";
import { type Draft, historyReducer, nearest, newDraft, nodeOf, type Place, toYaml } from "./draft";
import { Landmarks, Ways } from "./lists";
import { EditorMap } from "./map";
import { findings, Worth } from "./worth";

const POLL_MS = 300;
const TOOLS = ["landmark", "place", "way"] as const;
type Tool = (typeof TOOLS)[number];

export function Editor({ station, running }: { readonly station: Station; readonly running: RunningMission | undefined }) {
  const desk = useMemo(() => new Desk(station), [station]);
  const [world, setWorld] = useState<World>();
  const [begun, setBegun] = useState<Draft>();
  const [trouble, setTrouble] = useState<Trouble>();
  useEffect(() => {
    Promise.all([desk.world(), desk.running()]).then(
      ([found, draft]) => {
        setBegun(draft);
        setWorld(found);
      },
      (error: unknown) => setTrouble(asTrouble(error)),
    );
  }, [desk]);
  if (world) return <Drawing desk={desk} world={world} begun={begun} running={running} />;
  return trouble ? <Complaint trouble={trouble} /> : <p className="waiting">{texts.lookingAtTheBuilding}</p>;
}

interface DrawingProps {
  readonly desk: Desk;
  readonly world: World;
  /** The mission that was running when the editor was opened. */
  readonly begun: Draft | undefined;
  readonly running: RunningMission | undefined;
}

function Drawing({ desk, world, begun, running }: DrawingProps) {
  const [history, edit] = useReducer(historyReducer, world, ({ bounds, start }) => ({
    now: begun ?? newDraft(bounds, start),
    past: [],
  }));
  const [tool, setTool] = useState<Tool>("landmark");
  const [picked, setPicked] = useState<string>();
  const [profile, setProfile] = useState("sealed");
  const [trouble, setTrouble] = useState<Trouble>();
  const draft = history.now;
  const compiling = useCompiling(desk, setTrouble);
  const yaml = toYaml(draft);
  const current = compiling.of === profile + yaml;

  function onTap(at: Place, reach_m: number) {
    const node = nearest(draft.nodes, at, reach_m);
    if (tool === "way") {
      if (!node) setPicked(undefined);
      else if (picked === undefined || picked === node.name) setPicked(picked === node.name ? undefined : node.name);
      else {
        edit({ kind: "connect", from: picked, to: node.name });
        // Continue from here: a path is drawn with one tap per landmark.
        setPicked(node.name);
      }
    } else if (tool === "place") {
      edit({ kind: "place", at: [round(at[0]), round(at[1])] });
    } else {
      const site = nearest(
        world.sites.filter((each) => !nodeOf(draft, each)),
        at,
        reach_m,
      );
      if (site) edit({ kind: "site", site });
      else setPicked(node?.name);
    }
  }

  async function attempt(work: () => Promise<void>) {
    setTrouble(undefined);
    try {
      await work();
    } catch (error) {
      setTrouble(asTrouble(error));
    }
  }

  return (
    <main className="editor" data-testid="editor">
      <section className="card drawing">
        <div className="fields">
          <label className="grow">
            {texts.mission}
            <input
              data-testid="mission-name"
              value={draft.name}
              maxLength={60}
              onChange={(event) => edit({ kind: "title", name: event.target.value })}
            />
          </label>
          <div className="tools" role="group" aria-label={texts.whatATapDoes}>
            {TOOLS.map((each) => (
              <button
                key={each}
                type="button"
                data-testid={`tool-${each}`}
                aria-pressed={tool === each}
                onClick={() => {
                  setTool(each);
                  setPicked(undefined);
                }}
              >
                {texts.tools[each]}
              </button>
            ))}
          </div>
          <button type="button" data-testid="undo" disabled={history.past.length === 0} onClick={() => edit({ kind: "undo" })}>
            {texts.undo}
          </button>
        </div>
        <p className="quiet">{texts.toolHelp[tool]}</p>
        <EditorMap world={world} draft={draft} picked={picked} onTap={onTap} />
      </section>
      <div className="side">
        <section className="card">
          <div className="fields">
            <label className="grow">
              {texts.profile}
              <select data-testid="profile" value={profile} onChange={(event) => setProfile(event.target.value)}>
                <option value="sealed">{texts.profileSealed}</option>
                <option value="paper">{texts.profilePaper}</option>
              </select>
            </label>
            <button
              type="button"
              className="primary"
              data-testid="compile"
              disabled={compiling.busy}
              onClick={() => void attempt(() => compiling.start(yaml, profile))}
            >
              {texts.compile}
            </button>
            <button
              type="button"
              className="primary"
              data-testid="send"
              disabled={!compiling.compiled || !current || compiling.sent}
              onClick={() => void attempt(compiling.send)}
            >
              {texts.send}
            </button>
          </div>
          <Progress compiling={compiling} current={current} running={running} isTheRunning={draft === begun} />
          {trouble && <Complaint trouble={trouble} />}
        </section>
        {compiling.compiled && current && (
          <section className="card">
            <header>
              <h2>{texts.worth}</h2>
              <span className="quiet">
                {texts.fileOf(compiling.compiled.nodes, compiling.compiled.bytes, compiling.compiled.profile)}
              </span>
            </header>
            <Worth compiled={compiling.compiled} />
          </section>
        )}
        <Landmarks draft={draft} sites={world.sites} picked={picked} onPick={setPicked} edit={edit} />
        <Ways draft={draft} edit={edit} />
        <File draft={draft} yaml={yaml} onRead={(text) => attempt(async () => edit({ kind: "load", draft: await desk.read(text) }))} />
      </div>
    </main>
  );
}

interface Compiling {
  /** The compiled input: profile and YAML. */
  readonly of: string | undefined;
  readonly busy: boolean;
  readonly job: Job;
  readonly compiled: Compiled | undefined;
  readonly sent: boolean;
  readonly start: (yaml: string, profile: string) => Promise<void>;
  readonly send: () => Promise<void>;
}

function useCompiling(desk: Desk, onTrouble: (trouble: Trouble) => void): Compiling {
  const [of, setOf] = useState<string>();
  const [job, setJob] = useState<Job>({ state: "none" });
  const [sent, setSent] = useState(false);
  const busy = job.state === "compiling";

  useEffect(() => {
    if (!busy) return;
    let ended = false;
    const ask = async () => {
      try {
        const next = await desk.job();
        if (ended) return;
        setJob(next);
        if (next.state === "failed") onTrouble(next.trouble);
      } catch (error) {
        if (ended) return;
        setJob({ state: "none" });
        onTrouble(asTrouble(error));
      }
    };
    // Each answer is a new object, and starts the next wait.
    const timer = window.setTimeout(() => void ask(), POLL_MS);
    return () => {
      ended = true;
      window.clearTimeout(timer);
    };
  }, [busy, job, desk, onTrouble]);

  const compiled = job.state === "compiled" ? job.compiled : undefined;
  return {
    of,
    busy,
    job,
    compiled,
    sent,
    async start(yaml, profile) {
      setSent(false);
      await desk.compile(yaml, profile);
      setOf(profile + yaml);
      setJob({ state: "compiling", done: 0, of: 0 });
    },
    async send() {
      if (!compiled) return;
      await desk.send(compiled.id);
      setSent(true);
    },
  };
}

interface ProgressProps {
  readonly compiling: Compiling;
  readonly current: boolean;
  readonly running: RunningMission | undefined;
  /** The draft equals the mission that was running when the editor was opened. */
  readonly isTheRunning: boolean;
}

function Progress({ compiling, current, running, isTheRunning }: ProgressProps) {
  const { job, compiled, sent } = compiling;
  let text = texts.whatCompilingDoes;
  if (job.state === "compiling") text = job.of > 0 ? texts.compilingLocks(job.done, job.of) : texts.compiling;
  else if (compiled && !current) text = texts.changedSince;
  else if (sent && compiled && running?.id === compiled.id)
    text = texts.runsOnRobots(running.nodes - running.left, running.nodes);
  else if (sent) text = texts.sent;
  else if (compiled) text = compiledWords(findings(compiled));
  else if (running && isTheRunning) text = texts.runsOnRobots(running.nodes - running.left, running.nodes);
  return (
    <>
      {job.state === "compiling" && <progress max={Math.max(job.of, 1)} value={job.done} aria-label={texts.compiledBar} />}
      <p role="status" data-testid="mission-status">
        {text}
      </p>
    </>
  );
}

function compiledWords([first, ...more]: readonly string[]): string {
  return first === undefined ? texts.compiled : texts.compiledBut(first, more.length);
}

interface FileProps {
  readonly draft: Draft;
  readonly yaml: string;
  readonly onRead: (text: string) => Promise<void>;
}

function File({ draft, yaml, onRead }: FileProps) {
  const [text, setText] = useState<string>();
  const name = `${draft.name.replace(/[^\w-]+/g, "-") || "mission"}.yaml`;

  function download() {
    const url = URL.createObjectURL(new Blob([yaml], { type: "text/yaml" }));
    const link = document.createElement("a");
    link.href = url;
    link.download = name;
    link.click();
    URL.revokeObjectURL(url);
  }

  return (
    <details className="card">
      <summary>{texts.asAFile}</summary>
      <label>
        {texts.whatTheFileIs}
        <textarea
          data-testid="yaml"
          rows={10}
          spellCheck={false}
          value={text ?? yaml}
          onChange={(event) => setText(event.target.value)}
        />
      </label>
      <div className="fields">
        <button
          type="button"
          data-testid="import"
          disabled={text === undefined}
          onClick={() => void onRead(text ?? yaml).then(() => setText(undefined))}
        >
          {texts.drawIt}
        </button>
        <button type="button" data-testid="download" onClick={download}>
          {texts.download(name)}
        </button>
      </div>
    </details>
  );
}

function Complaint({ trouble }: { readonly trouble: Trouble }) {
  return (
    <p className="trouble" role="alert" data-testid="mission-trouble">
      {trouble.message}
      {trouble.hint !== "" && <span className="hint">{texts.hint(trouble.hint)}</span>}
    </p>
  );
}

function asTrouble(error: unknown): Trouble {
  return error instanceof Trouble ? error : new Trouble(texts.pageBroke);
}

function round(value: number): number {
  return Math.round(value * 100) / 100;
}
