"use strict";
// Stands for Visual Studio Code: activates the extension, calls all of its commands, and talks to the server it starts.
// node vscode_host.js EXTENSION CELL FOLDER TREE; prints one JSON object.
const Module = require("node:module");
const { spawn } = require("node:child_process");
const { readFileSync } = require("node:fs");
const { pathToFileURL } = require("node:url");
const [extension, cell, folder, tree] = process.argv.slice(2);
const told = { commands: [], terminals: [], errors: [], pages: [] };
const declared = JSON.parse(readFileSync(`${extension}/package.json`, "utf8")).contributes.configuration.properties;
const registered = {};
let started;

const own = {}; // what the extension gave for debugging
const keep = (name) => (...given) => ((own[name] = given[given.length - 1]), { dispose() {} });
const vscode = {
  ThemeColor: class { constructor(id) { this.id = id; } },
  DebugAdapterExecutable: class { constructor(command, args, options) { Object.assign(this, { command, args, options }); } },
  debug: {
    startDebugging: (_, launch) => { told.launched = launch; },
    registerDebugAdapterDescriptorFactory: keep("adapter"),
    registerDebugConfigurationProvider: keep("completed"),
    onDidReceiveDebugSessionCustomEvent: keep("event"),
    onDidTerminateDebugSession: keep("ended"),
  },
  ViewColumn: { Beside: -2 },
  commands: { registerCommand: (name, does) => ((registered[name] = does), { dispose() {} }) },
  workspace: {
    workspaceFolders: [{ uri: { fsPath: folder } }],
    getConfiguration: () => ({ get: (key) => (key === "command" ? cell : declared[`cell.${key}`].default) }),
  },
  window: {
    activeTextEditor: { document: { uri: { fsPath: tree } } },
    showErrorMessage: (text) => told.errors.push(text),
    createTerminal: (options) => (told.terminals.push([options.shellPath, ...options.shellArgs]), { show() {} }),
    visibleTextEditors: [],
    createTextEditorDecorationType: (options) => ({ mark: options.after.contentText.trim(), dispose() {} }),
    onDidChangeVisibleTextEditors: () => ({ dispose() {} }),
    createWebviewPanel: () => ({ webview: { set html(text) { told.pages.push(text.length); told.page = text.slice(0, 200); } } }),
  },
};
class LanguageClient {
  constructor(id, name, server, client) { Object.assign(this, { server, client }); }
  async start() { started = this; }
  async stop() { told.stopped = (told.stopped ?? 0) + 1; }
}
const load = Module._load;
Module._load = (name, ...rest) =>
  name === "vscode" ? vscode : name === "vscode-languageclient/node" ? { LanguageClient } : load(name, ...rest);

// The debugger as the editor starts it: it names what it can, and its statuses become marks beside the lines.
async function debugs() {
  const { command, args, options } = own.adapter.createDebugAdapterDescriptor();
  const child = spawn(command, args, { cwd: options.cwd, stdio: ["pipe", "pipe", "inherit"] });
  const text = JSON.stringify({ seq: 1, type: "request", command: "initialize", arguments: {} });
  child.stdin.write(`Content-Length: ${Buffer.byteLength(text)}\r\n\r\n${text}`);
  const answer = await new Promise((done) => child.stdout.once("data", (piece) => done(piece.toString())));
  told.debugger = JSON.parse(answer.slice(answer.indexOf("{"))).body;
  child.stdin.end();
  await new Promise((done) => child.on("exit", done));
  told.completed = own.completed.resolveDebugConfiguration(undefined, {});
  const shown = {}, document = { uri: { fsPath: tree }, lineCount: 3, lineAt: (line) => ({ range: line + 1 }) };
  vscode.window.visibleTextEditors.push({ document, setDecorations: ({ mark }, lines) => { shown[mark] = [...(shown[mark] ?? []), ...lines]; } });
  own.event({ event: "cell.statuses", body: { [tree]: { 1: 1, 2: 2, 3: 13, 99: 1 } } });
  told.marked = { ...shown };
  for (const mark of Object.keys(shown)) delete shown[mark];
  own.ended();
  told.unmarked = shown;
}

function talk(server) { // the protocol's framing: a header with the length, then JSON
  const child = spawn(server.command, server.args, { cwd: server.options.cwd, stdio: ["pipe", "pipe", "inherit"] });
  const waiting = new Map(), notes = [];
  let held = Buffer.alloc(0), number = 0;
  child.stdout.on("data", (piece) => {
    held = Buffer.concat([held, piece]);
    for (;;) {
      const head = /Content-Length: (\d+)[^]*?\r\n\r\n/.exec(held.subarray(0, 200).toString());
      if (!head || held.length < head[0].length + +head[1]) return;
      const message = JSON.parse(held.subarray(head[0].length, head[0].length + +head[1]));
      held = held.subarray(head[0].length + +head[1]);
      if (message.method === undefined) waiting.get(message.id)(message.result);
      else for (const one of [...notes]) if (one.method === message.method) one.done(message.params);
    }
  });
  const send = (message) => {
    const text = JSON.stringify({ jsonrpc: "2.0", ...message });
    child.stdin.write(`Content-Length: ${Buffer.byteLength(text)}\r\n\r\n${text}`);
  };
  return {
    child,
    tell: (method, params) => send({ method, params }),
    ask: (method, params) => new Promise((done) => { waiting.set(++number, done); send({ id: number, method, params }); }),
    hear: (method) => new Promise((done) => notes.push({ method, done })),
  };
}

async function main() {
  const { activate, deactivate } = require(`${extension}/extension.js`);
  await activate({ subscriptions: [] });
  told.commands = Object.keys(registered);
  told.selector = started.client.documentSelector;
  for (const name of told.commands) await registered[name]();
  const server = talk(started.server);
  const uri = pathToFileURL(tree).href, text = readFileSync(tree, "utf8");
  const { capabilities } = await server.ask("initialize", { processId: null, rootUri: pathToFileURL(folder).href, capabilities: {} });
  told.capabilities = Object.keys(capabilities);
  server.tell("initialized", {});
  const marks = server.hear("textDocument/publishDiagnostics");
  server.tell("textDocument/didOpen", { textDocument: { uri, languageId: "xml", version: 1, text } });
  told.marks = (await marks).diagnostics.map((one) => one.message);
  const range = { start: { line: 0, character: 0 }, end: { line: 99, character: 0 } };
  const actions = await server.ask("textDocument/codeAction", { textDocument: { uri }, range, context: { diagnostics: [] } });
  told.actions = actions.map((one) => one.title);
  await server.ask("shutdown");
  server.tell("exit");
  await new Promise((done) => server.child.on("exit", done));
  await debugs();
  await deactivate();
  process.stdout.write(JSON.stringify(told));
}
main().catch((error) => { console.error(error); process.exit(1); });
