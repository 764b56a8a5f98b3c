// The ATmega2560 of the firmware on avr8js, a processor that other people wrote than simavr's.
//
// Converter, serial line, EEPROM, watchdog and ports are avr8js's own, at the addresses of the
// ATmega2560. The two timers are ours: avr8js makes an event of every count of a timer, which for
// timers without a prescaler is an event a cycle.
import { readFileSync } from 'node:fs';
import {
  ADCMuxInputType, AVRADC, AVRClock, AVREEPROM, AVRUSART, AVRWatchdog, CPU, EEPROMMemoryBackend, adcConfig,
  avrInstruction, clockConfig, eepromConfig, usart0Config, watchdogConfig,
} from 'avr8js';

export const CLOCK_HZ = 16_000_000;

const FLASH_BYTES = 0x40000;
const RAM_END = 0x21ff;
// Data-space addresses and vectors of the data sheet.
const GPIOR0 = 0x3e, SMCR = 0x53, MCUSR = 0x54;
const PORTS = { A: 0x20, B: 0x23, D: 0x29, E: 0x2c };
const STEP_BIT = 5, DIRECTION_BIT = 0, ENABLE_BIT = 2;
const RECEIVED = 0x80; // RXC of UCSR0A
const word = (vector) => vector * 2;
const SLEEP = 0x9588;
// 1.1 V / 5 V of 1 024 counts, cut off as simavr does.
const REFERENCE_COUNTS = 225;
// Five cycles to enter an interrupt and five more out of a sleep (data sheet, 7.8.1); avr8js
// itself takes two, so that entry is done here.
const ENTRY_CYCLES = 5, WAKE_CYCLES = 5;

/** The flash of an ELF file: its loaded segments at their physical addresses. */
export function flashOf(path) {
  const elf = readFileSync(path);
  const flash = new Uint8Array(FLASH_BYTES).fill(0xff);
  const headers = elf.readUInt32LE(28), size = elf.readUInt16LE(42), count = elf.readUInt16LE(44);
  for (let index = 0; index < count; index++) {
    const at = headers + index * size;
    const bytes = elf.readUInt32LE(at + 16);
    if (elf.readUInt32LE(at) !== 1 || bytes === 0) continue;
    const from = elf.readUInt32LE(at + 4);
    flash.set(elf.subarray(from, from + bytes), elf.readUInt32LE(at + 12));
  }
  return flash;
}

/** A 16-bit timer without a prescaler, in normal mode or cleared on a match of unit A. */
class Timer {
  constructor(board, { base, flags, enable, vectors, onToggle }) {
    this.board = board;
    this.cpu = board.cpu;
    this.base = base;
    this.onToggle = onToggle;
    this.zeroAt = 0;
    this.stopped = 0;
    this.isRunning = false;
    this.compare = [0, 0];
    this.high = 0;
    this.interrupts = vectors.map((vector, unit) => ({
      address: word(vector), flagRegister: flags, flagMask: 2 << unit,
      enableRegister: enable, enableMask: 2 << unit,
    }));
    this.events = [0, 1].map((unit) => () => this.matched(unit));
    const { readHooks, writeHooks, data } = this.cpu;
    const counter = base + 4, units = [base + 8, base + 10];
    readHooks[counter] = () => {
      const count = this.count();
      this.high = count >> 8;
      return count & 0xff;
    };
    readHooks[counter + 1] = () => this.high;
    for (const register of [counter, ...units]) {
      writeHooks[register + 1] = (value) => { this.high = value; return true; };
    }
    writeHooks[counter] = (low) => { this.restart((this.high << 8) | low); return true; };
    units.forEach((register, unit) => {
      writeHooks[register] = (low) => {
        const count = this.count();
        this.compare[unit] = (this.high << 8) | low;
        data[register] = low;
        data[register + 1] = this.high;
        this.restart(count);
        return true;
      };
    });
    writeHooks[base] = (value) => { data[base] = value; return true; };
    writeHooks[base + 1] = (value) => {
      if (value & 0b110) throw new Error(`timer at ${base}: a prescaler is not modelled`);
      const count = this.count();
      data[base + 1] = value;
      this.isRunning = (value & 1) !== 0;
      this.restart(count);
      return true;
    };
    writeHooks[flags] = (value) => {
      for (const interrupt of this.interrupts) this.cpu.clearInterruptByFlag(interrupt, value);
      return true;
    };
    writeHooks[enable] = (value) => {
      data[enable] = value;
      for (const interrupt of this.interrupts) this.cpu.updateInterruptEnable(interrupt, value);
      return true;
    };
  }

  period() {
    const clearsOnMatch = this.cpu.data[this.base + 1] & 8;
    return (clearsOnMatch ? this.compare[0] : 0xffff) + 1;
  }

  count() {
    return this.isRunning ? (this.cpu.cycles - this.zeroAt) % this.period() : this.stopped;
  }

  restart(count) {
    this.stopped = count;
    this.zeroAt = this.cpu.cycles - count;
    const period = this.period();
    [0, 1].forEach((unit) => {
      this.cpu.clearClockEvent(this.events[unit]);
      // A unit beyond the top never matches.
      if (!this.isRunning || this.compare[unit] >= period) return;
      const ahead = (this.compare[unit] - count + period) % period || period;
      this.cpu.addClockEvent(this.events[unit], ahead);
    });
  }

  matched(unit) {
    const due = this.board.due;
    this.cpu.addClockEvent(this.events[unit], due + this.period() - this.cpu.cycles);
    const togglesPin = this.cpu.data[this.base] >> 6 === 1;
    if (unit === 0 && togglesPin) this.onToggle?.();
    this.cpu.setInterruptFlag(this.interrupts[unit]);
  }
}

/** A board that runs an image. */
export class Board {
  constructor(flash) {
    this.cpu = new CPU(new Uint16Array(flash.buffer), RAM_END + 1 - 0x100);
    this.due = 0;
    this.output = [];
    this.marks = [];
    this.inputs = { A: 0, B: 0, D: 0, E: 0 };
    this.position = 0;
    this.waiting = [];
    this.step = false;
    const { cpu } = this, { data, readHooks, writeHooks } = cpu;
    cpu.reset();
    data[MCUSR] = 0;
    const toggle = () => this.toggled();
    new Timer(this, { base: 0x80, flags: 0x36, enable: 0x6f, vectors: [17, 18], onToggle: toggle });
    new Timer(this, { base: 0x90, flags: 0x38, enable: 0x71, vectors: [32, 33] });
    for (const [port, base] of Object.entries(PORTS)) {
      readHooks[base] = () => {
        const levels = (data[base + 1] & data[base + 2]) | (~data[base + 1] & this.inputs[port]);
        // What the timer drives is read as it is, whatever the port's bit says.
        return port === 'B' && this.step ? levels | 1 << STEP_BIT : levels;
      };
      writeHooks[base] = (value) => { data[base + 2] ^= value; return true; };
    }
    this.serial = new AVRUSART(cpu, {
      ...usart0Config,
      rxCompleteInterrupt: word(25), dataRegisterEmptyInterrupt: word(26), txCompleteInterrupt: word(27),
    }, CLOCK_HZ);
    // The flag says that the register is empty, and stays until it is not: avr8js drops it when the
    // interrupt is entered, and a handler without a byte to send would wait for ever.
    this.serial.UDRE.constant = true;
    // avr8js forgets a received byte when UCSR0B is written, which the sender does to fall silent.
    const { UCSRA, UCSRB } = usart0Config, configured = writeHooks[UCSRB];
    writeHooks[UCSRB] = (value, ...rest) => {
      const isReceived = data[UCSRA] & RECEIVED, isDone = configured(value, ...rest);
      if (isReceived) cpu.setInterruptFlag(this.serial.RXC);
      return isDone;
    };
    this.serial.onByteTransmit = (byte) => this.output.push(byte);
    this.serial.onRxComplete = () => this.feed();
    this.converter = new AVRADC(cpu, { ...adcConfig, adcInterrupt: word(29) });
    this.levels = { 0: 0, 1: 0 };
    this.converter.onADCRead = ({ type, channel }) => {
      // Multiplexer 0x1e is the reference of 1.1 V, here by a supply of 5 V.
      const counts = type === ADCMuxInputType.Constant ? REFERENCE_COUNTS : this.levels[channel] ?? 0;
      const done = () => this.converter.completeADCRead(counts);
      cpu.addClockEvent(done, this.converter.sampleCycles);
    };
    new AVREEPROM(cpu, new EEPROMMemoryBackend(4096), { ...eepromConfig, eepromReadyInterrupt: word(30) });
    const clock = new AVRClock(cpu, CLOCK_HZ, clockConfig);
    new AVRWatchdog(cpu, { ...watchdogConfig, watchdogInterrupt: word(12) }, clock);
    let open = 0, from = 0;
    writeHooks[GPIOR0] = (value) => {
      if (open !== 0 && value === 0) this.marks.push([open, cpu.cycles - from]);
      open = value;
      from = cpu.cycles;
      data[GPIOR0] = value;
      return true;
    };
  }

  /** A rising edge is a microstep if the driver is on. */
  toggled() {
    this.step = !this.step;
    const port = this.cpu.data[PORTS.A + 2], driven = this.cpu.data[PORTS.A + 1];
    const isOn = (driven >> ENABLE_BIT & 1) === 1 && (port >> ENABLE_BIT & 1) === 0;
    if (this.step && isOn) this.position += port >> DIRECTION_BIT & 1 ? 1 : -1;
  }

  /** Sends a line to the board, byte by byte as the line takes them. */
  send(text) {
    this.waiting.push(...Buffer.from(text, 'latin1'));
    this.feed();
  }

  feed() {
    if (this.waiting.length > 0 && this.serial.writeByte(this.waiting[0])) this.waiting.shift();
  }

  /** Events that are due, each at its own cycle. */
  serve() {
    const { cpu } = this;
    for (let event = cpu.nextClockEvent; event && event.cycles <= cpu.cycles; event = cpu.nextClockEvent) {
      cpu.nextClockEvent = event.next;
      this.due = event.cycles;
      event.callback();
    }
  }

  /** Runs up to a cycle. */
  run(until) {
    const { cpu } = this;
    while (cpu.cycles < until) {
      const instruction = cpu.progMem[cpu.pc];
      const wasOff = !cpu.interruptsEnabled;
      if (instruction === SLEEP && cpu.data[SMCR] & 1) {
        cpu.pc++;
        cpu.cycles++;
        this.serve();
        while (cpu.nextInterrupt < 0 && cpu.cycles < until && cpu.nextClockEvent) {
          cpu.cycles = Math.max(cpu.cycles, cpu.nextClockEvent.cycles);
          this.serve();
        }
        if (cpu.nextInterrupt >= 0) cpu.cycles += WAKE_CYCLES;
      } else {
        avrInstruction(cpu);
        this.serve();
        // The instruction after interrupts are switched on comes before any of them.
        if (wasOff) continue;
      }
      if (cpu.interruptsEnabled && cpu.nextInterrupt >= 0) this.interrupt();
    }
  }

  interrupt() {
    const { cpu } = this, { data } = cpu;
    const pending = cpu.pendingInterrupts[cpu.nextInterrupt];
    for (const byte of [cpu.pc & 0xff, cpu.pc >> 8 & 0xff, cpu.pc >> 16]) {
      data[cpu.SP] = byte;
      cpu.SP -= 1;
    }
    data[95] &= 0x7f;
    cpu.cycles += ENTRY_CYCLES;
    cpu.pc = pending.address;
    if (!pending.constant) cpu.clearInterrupt(pending);
    this.serve();
  }
}
