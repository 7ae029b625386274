// An agent of LlamaIndex.TS plays one episode; docs/clients.md says how it is started.
//
//     npm install llamaindex@0.12.1 @llamaindex/openai@0.4.22 @llamaindex/tools@0.1.12 @llamaindex/workflow@1.1.24

import { OpenAI } from "@llamaindex/openai";
import { mcp } from "@llamaindex/tools";
import { agent } from "@llamaindex/workflow";

const { OPENAI_BASE_URL, OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const server = mcp({ url: SMARTPLAY_MCP_URL });
const llm = new OpenAI({ model: OPENAI_MODEL, baseURL: OPENAI_BASE_URL, apiKey: "none", supportToolCall: true });
const player = agent({ llm, tools: await server.tools() });
console.log((await player.run("Play.")).data.result);
await server.cleanup();
