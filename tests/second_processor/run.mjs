// node run.mjs IMAGE SCRIPT: runs the image through a script of `SECONDS WHAT …` lines and prints
// what it said, its cycle marks and its steps, as `virtual-rig run --script` does.
import { readFileSync, writeSync } from 'node:fs';
import { Board, CLOCK_HZ, flashOf } from './board.mjs';

const [image, script] = process.argv.slice(2);
const board = new Board(flashOf(image));
for (const line of readFileSync(script, 'latin1').split('\n')) {
  if (line.trim() === '' || line.startsWith('#')) continue;
  const [seconds, what, ...rest] = line.split(' ');
  board.run(Math.round(Number(seconds) * CLOCK_HZ));
  switch (what) {
    case 'send': board.send(`${rest.join(' ')}\n`); break;
    case 'counts': board.levels[rest[0]] = Number(rest[1]); break;
    case 'pin': {
      const [port, bit, level] = [rest[0][0], Number(rest[0][1]), Number(rest[1])];
      board.inputs[port] = board.inputs[port] & ~(1 << bit) | level << bit;
      break;
    }
    case 'end': break;
    default: throw new Error(`not a line of a script: ${line}`);
  }
}
writeSync(1, Buffer.from(board.output));
const marks = board.marks.map(([id, cycles]) => `mark ${id} ${cycles}\n`);
writeSync(2, `${marks.join('')}position ${board.position}\n`);
