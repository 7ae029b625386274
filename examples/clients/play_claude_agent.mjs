// An agent of Claude Agent SDK plays one episode; docs/clients.md says how it is started.
//
//     npm install @anthropic-ai/claude-agent-sdk@0.3.330
//     smartplay-tools agent ... --only-game-tools

import { query } from "@anthropic-ai/claude-agent-sdk";

const options = {
  model: process.env.ANTHROPIC_MODEL,
  mcpServers: { smartplay: { type: "http", url: process.env.SMARTPLAY_MCP_URL } },
  allowedTools: ["mcp__smartplay"],
  strictMcpConfig: true,
  settingSources: [],
  env: { ...process.env, CLAUDE_CODE_DISABLE_NONESSENTIAL_TRAFFIC: "1" },
};
for await (const message of query({ prompt: "Play the game until it is over.", options })) console.log(message.type);
