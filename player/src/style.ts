export const STYLE = `
:host { display: block; position: relative; min-height: 120px; overflow: hidden; background: #000; color: #eee; contain: content;
  font: 14px/1.4 system-ui, sans-serif; }
:host([hidden]) { display: none; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; cursor: grab; display: block; }
canvas:active { cursor: grabbing; }
:focus-visible { outline: 2px solid #6cf; outline-offset: -2px; }
.bar { position: absolute; inset: auto 0 0 0; display: flex; flex-wrap: wrap; align-items: center; gap: 2px 4px; padding: 6px 8px;
  background: linear-gradient(transparent, #000c 40%); }
.bar input[type=range] { flex: 1 1 120px; min-width: 80px; accent-color: #6cf; height: 24px; margin: 0 4px; }
button, select, input { font: inherit; color: inherit; }
button { min-width: 36px; height: 36px; padding: 0 6px; background: none; border: 0; border-radius: 6px; cursor: pointer; }
button svg { width: 20px; height: 20px; fill: currentColor; display: block; margin: auto; }
button:hover, button[aria-expanded=true] { background: #fff3; }
button[aria-pressed=true] { color: #6cf; }
.time { font-variant-numeric: tabular-nums; min-width: 5.5em; text-align: center; }
.panel { position: absolute; right: 8px; bottom: 56px; max-width: calc(100% - 16px); max-height: calc(100% - 72px); overflow: auto;
  box-sizing: border-box; padding: 10px 14px; background: #181c22f2; border-radius: 8px; display: grid; grid-template-columns: auto auto;
  gap: 8px 12px; align-items: center; }
.bar[hidden], .panel[hidden], .note[hidden], .numbers[hidden], .wait[hidden] { display: none; }
select, .panel input { background: #2a3038; border: 1px solid #556; border-radius: 5px; padding: 3px 5px; }
.numbers { position: absolute; left: 8px; top: 8px; margin: 0; padding: 6px 10px; background: #000a; border-radius: 6px;
  font: 12px/1.5 ui-monospace, monospace; pointer-events: none; white-space: pre; }
.note { position: absolute; left: 50%; top: 40%; transform: translate(-50%, -50%); width: max-content; max-width: calc(100% - 40px);
  box-sizing: border-box; padding: 14px 18px; background: #5a1d1df5; border-radius: 8px; overflow-wrap: anywhere; }
.note code { background: #0006; padding: 1px 5px; border-radius: 4px; }
.note button { background: #fff3; margin-top: 8px; padding: 0 12px; }
.wait { position: absolute; right: 10px; top: 10px; padding: 4px 10px; background: #000a; border-radius: 6px; }
`;

/** paths of 24 x 24 icons */
export const ICONS = {
  play: "M8 5v14l11-7z", pause: "M6 5h4v14H6zm8 0h4v14h-4z", back: "M6 6h2v12H6zm12 0v12L9.5 12z", next: "M16 6h2v12h-2zM6 6l8.5 6L6 18z",
  loop: "M7 7h10v3l4-4-4-4v3H5v6h2zm10 10H7v-3l-4 4 4 4v-3h12v-6h-2z",
  view: "M12 5a7 7 0 1 0 7 7h-2a5 5 0 1 1-5-5v3l4-4-4-4z",
  more: "M4 7h9v2H4zm13 0h3v2h-3zm-3-2h2v6h-2zM4 15h3v2H4zm7 0h9v2h-9zm-3-2h2v6H8z",
  full: "M5 5h6v2H7v4H5zm14 0v6h-2V7h-4V5zM5 19v-6h2v4h4v2zm14 0h-6v-2h4v-4h2z",
};
