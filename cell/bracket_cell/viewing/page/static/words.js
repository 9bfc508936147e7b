// The catalogue of the page: messages come as texts, or as [id, values], and are looked up when they are shown.
let texts = {};
let names = {}; // titles of types of parts

export async function learn(language) {
  const answer = await fetch(`words/${language}.json`);
  const told = answer.ok ? await answer.json() : { language: "en", languages: ["en"], texts: {} };
  texts = told.texts;
  document.documentElement.lang = told.language;
  return told;
}

export function name(titles) {
  names = titles;
}

export function t(message, values = null) {
  if (message === null || message === undefined) return "";
  if (Array.isArray(message)) return t(message[0], message[1]);
  const template = texts[message] ?? String(message);
  if (!values) return template;
  return template.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? t(names[values[name]] ?? values[name]) : whole));
}
