"use strict";
// The language server of tree files, and commands that show, check, run and replay them; all of it is `cell`.
const { execFile } = require("node:child_process");
const { mkdtempSync, readFileSync, rmSync } = require("node:fs");
const { tmpdir } = require("node:os");
const { basename, join } = require("node:path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

const settings = () => vscode.workspace.getConfiguration("cell");
const folder = () => vscode.workspace.workspaceFolders?.[0]?.uri.fsPath;
const chosen = (uri) => (uri ?? vscode.window.activeTextEditor?.document.uri)?.fsPath;

async function serve() {
  const options = { cwd: folder() };
  client = new LanguageClient(
    "cell",
    "Bracket cell",
    { command: settings().get("command"), args: ["lsp"], options },
    { documentSelector: [{ scheme: "file", language: "xml", pattern: settings().get("files") }] },
  );
  try {
    await client.start();
  } catch (error) {
    const told = `cell lsp does not start: ${error.message}; name the program in the setting cell.command`;
    vscode.window.showErrorMessage(told);
  }
}

// Runs `cell` in a terminal of its own, where people read it and stop it.
function terminal(title, words, beside = false) {
  const location = beside ? { viewColumn: vscode.ViewColumn.Beside } : undefined;
  const made = vscode.window.createTerminal({
    name: title, cwd: folder(), shellPath: settings().get("command"), shellArgs: words, location,
  });
  made.show(true);
  return made;
}

// The page that `cell show` writes, beside the text.
function show(uri) {
  const file = chosen(uri), target = mkdtempSync(join(tmpdir(), "cell-")), page = join(target, "tree.html");
  return new Promise((done) => {
    const words = ["show", file, "--html", page];
    execFile(settings().get("command"), words, { cwd: folder(), maxBuffer: 1 << 26 }, (error, _, said) => {
      if (error) {
        vscode.window.showErrorMessage(said.trim() || error.message);
      } else {
        const column = vscode.ViewColumn.Beside, may = { enableScripts: true, localResourceRoots: [] };
        vscode.window.createWebviewPanel("cell.tree", basename(file), column, may).webview.html = readFileSync(page, "utf8");
      }
      rmSync(target, { recursive: true, force: true });
      done();
    });
  });
}

// Runs a tree in the debugger, which is `cell dap`: breakpoints, steps, blackboard, and its output in the debug console.
function debug(uri) {
  const launch = { type: "cell", request: "launch", name: basename(chosen(uri)), program: chosen(uri) };
  return vscode.debug.startDebugging(vscode.workspace.workspaceFolders?.[0], launch);
}

const adapter = {
  createDebugAdapterDescriptor: () =>
    new vscode.DebugAdapterExecutable(settings().get("command"), ["dap"], { cwd: folder() }),
};
const completed = { // what a person left out, as for F5 without a launch.json
  resolveDebugConfiguration: (_, asked) => {
    const made = asked.type ? asked : { type: "cell", request: "launch", name: "This tree", program: "${file}" };
    return made.request === "launch" ? { args: settings().get("runArguments"), ...made } : made;
  },
};

// What the nodes of each line do, beside the text: [numbers of Groot2's protocol, mark, colour].
const STATES = [
  [[1], "▶", "charts.yellow"], [[2], "✔", "charts.green"], [[3], "✘", "charts.red"],
  [[12], "✔", "disabledForeground"], [[13], "✘", "disabledForeground"],
];
let marks = [], states = {};
function paint() {
  for (const editor of vscode.window.visibleTextEditors) {
    const lines = Object.entries(states[editor.document.uri.fsPath] ?? {});
    STATES.forEach(([codes], turn) => {
      const there = lines.filter(([line, code]) => codes.includes(code) && line <= editor.document.lineCount);
      editor.setDecorations(marks[turn], there.map(([line]) => editor.document.lineAt(line - 1).range));
    });
  }
}
function live() {
  marks = STATES.map(([, contentText, colour]) => vscode.window.createTextEditorDecorationType({
    after: { contentText: `  ${contentText}`, color: new vscode.ThemeColor(colour) },
  }));
  const tell = (told) => { states = told; paint(); };
  return [
    ...marks,
    vscode.debug.registerDebugAdapterDescriptorFactory("cell", adapter),
    vscode.debug.registerDebugConfigurationProvider("cell", completed),
    vscode.debug.onDidReceiveDebugSessionCustomEvent(({ event, body }) => event === "cell.statuses" && tell(body)),
    vscode.debug.onDidTerminateDebugSession(() => tell({})),
    vscode.window.onDidChangeVisibleTextEditors(paint),
  ];
}

const COMMANDS = {
  "cell.show": show,
  "cell.check": (uri) => terminal("cell check", ["check", chosen(uri)]),
  "cell.run": debug,
  "cell.monitor": () => terminal("cell show --running", ["show", "--running"], true),
  "cell.replay": (uri) => terminal("cell replay", ["replay", chosen(uri)]),
  "cell.restart": async () => {
    await client?.stop();
    await serve();
  },
};

async function activate(context) {
  for (const [name, does] of Object.entries(COMMANDS)) {
    context.subscriptions.push(vscode.commands.registerCommand(name, does));
  }
  context.subscriptions.push(...live());
  await serve();
}

module.exports = { activate, deactivate: () => client?.stop() };
