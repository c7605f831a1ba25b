// Writes ../assets: page.js and page.css, each one file, and the licences of what is in them. `npm ci && npm run build`.
import { build } from "esbuild";
import { readFileSync, writeFileSync } from "node:fs";

const assets = new URL("../assets/", import.meta.url);

await build({
  entryPoints: { page: "src/main.js" },
  bundle: true,
  minify: true,
  format: "iife",
  target: ["chrome103", "firefox113", "safari16.4"], // the oldest that inflate by DecompressionStream
  charset: "ascii",
  legalComments: "none", // LICENCES.txt has them whole, and stands in every page
  outdir: assets.pathname,
  absWorkingDir: new URL(".", import.meta.url).pathname,
  logLevel: "info",
});

const licences = ["three", "uplot"].map((name) => {
  const { version } = JSON.parse(readFileSync(new URL(`node_modules/${name}/package.json`, import.meta.url)));
  const text = readFileSync(new URL(`node_modules/${name}/LICENSE`, import.meta.url), "utf8");
  return `${name} ${version}\n\n${text.replaceAll("\r", "").trim()}\n`;
});
writeFileSync(new URL("LICENCES.txt", assets), licences.join("\n----\n\n"));
