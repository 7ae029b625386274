# Claude Code plays one episode; docs/clients.md says how it is started.
#
#     npm install @anthropic-ai/claude-code@2.1.197
#     smartplay-tools agent ... --only-game-tools

home=$(mktemp -d)
cat > "$home/mcp.json" <<END
{"mcpServers": {"smartplay": {"type": "http", "url": "$SMARTPLAY_MCP_URL"}}}
END
HOME=$home CLAUDE_CODE_DISABLE_NONESSENTIAL_TRAFFIC=1 ./node_modules/.bin/claude \
    --print "Play the game until it is over." \
    --mcp-config "$home/mcp.json" --strict-mcp-config --allowedTools mcp__smartplay --max-turns 1000
