// Prints what the Khronos validator says of GLB files: a line for each message, nothing if all is well.
const fs = require('fs');
const validator = require('gltf-validator');

async function main() {
  for (const file of process.argv.slice(2)) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
    for (const message of report.issues.messages) {
      console.log(`${file}: ${message.code} ${message.pointer}: ${message.message}`);
    }
  }
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
