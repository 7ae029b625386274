// An agent of OpenAI's package plays one episode; docs/clients.md says how it is started.
//
//     npm install openai@6.49.0 @modelcontextprotocol/sdk@1.32.2

import { Client } from "@modelcontextprotocol/sdk/client/index.js";
import { StreamableHTTPClientTransport } from "@modelcontextprotocol/sdk/client/streamableHttp.js";
import OpenAI from "openai";

const { OPENAI_MODEL, SMARTPLAY_MCP_URL } = process.env;
const server = new Client({ name: "player", version: "1.0.0" });
await server.connect(new StreamableHTTPClientTransport(new URL(SMARTPLAY_MCP_URL)));
const { tools } = await server.listTools();
const run = new OpenAI().chat.completions.runTools(
  {
    model: OPENAI_MODEL,
    messages: [{ role: "user", content: "Play." }],
    tools: tools.map(({ name, description, inputSchema }) => ({
      type: "function",
      function: {
        name,
        description,
        parameters: inputSchema,
        parse: JSON.parse,
        function: async (args) => (await server.callTool({ name, arguments: args })).content[0].text,
      },
    })),
  },
  { maxChatCompletions: 1000 },
);
console.log(await run.finalContent());
await server.close();
