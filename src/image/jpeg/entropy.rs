//! Bits, and the Huffman codes of JPEG (T.81, annexes B.1.1.5, C, F.2.2.3 and K.2).

use super::Unsupported;

const ENDS: Unsupported = Unsupported("it is cut or damaged: its data end too early");

/// Bits of one scan.
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    bits: u64,
    have: u32,
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Reader { bytes, at: 0, bits: 0, have: 0 }
    }

    fn fill(&mut self) {
        while self.have <= 48 {
            let Some(&byte) = self.bytes.get(self.at) else { return };
            if byte == 0xFF {
                if self.bytes.get(self.at + 1) != Some(&0) {
                    return;
                }
                self.at += 1;
            }
            self.at += 1;
            self.bits = self.bits << 8 | byte as u64;
            self.have += 8;
        }
    }

    /// The next `n ≤ 16` bits.
    pub fn bits(&mut self, n: u32) -> Result<u32, Unsupported> {
        if self.have < n {
            self.fill();
            if self.have < n {
                return Err(ENDS);
            }
        }
        self.have -= n;
        Ok((self.bits >> self.have) as u32 & ((1 << n) - 1))
    }

    /// The next symbol.
    pub fn symbol(&mut self, code: &Code) -> Result<u8, Unsupported> {
        if self.have < 16 {
            self.fill();
        }
        let next = if self.have >= 16 { self.bits >> (self.have - 16) } else { self.bits << (16 - self.have) };
        match code.find(next as u16) {
            Some((length, symbol)) if length <= self.have => {
                self.have -= length;
                Ok(symbol)
            }
            _ if self.have < 16 => Err(ENDS),
            _ => Err(Unsupported("it is damaged: a code that its tables do not have")),
        }
    }

    /// A number of `n ≤ 15` bits with its sign (T.81, F.2.2.1).
    pub fn signed(&mut self, n: u32) -> Result<i32, Unsupported> {
        if n == 0 {
            return Ok(0);
        }
        let value = self.bits(n)? as i32;
        Ok(if value >> (n - 1) == 0 { value - (1 << n) + 1 } else { value })
    }

    /// Go on behind restart marker `k`.
    pub fn restart(&mut self, k: u32) -> Result<(), Unsupported> {
        self.fill();
        let marker = [0xFF, 0xD0 | (k & 7) as u8];
        if self.have >= 8 || self.bytes.get(self.at..self.at + 2) != Some(&marker) {
            return Err(Unsupported("it is damaged: a restart marker is not where it belongs"));
        }
        (self.at, self.bits, self.have) = (self.at + 2, 0, 0);
        Ok(())
    }

    /// Check that all was read.
    pub fn end(mut self) -> Result<(), Unsupported> {
        self.fill();
        if self.have >= 8 || self.at != self.bytes.len() {
            return Err(Unsupported("it is damaged: data behind the last block of a scan"));
        }
        Ok(())
    }
}

/// Bits on their way out.
#[derive(Default)]
pub struct Writer {
    pub out: Vec<u8>,
    bits: u64,
    have: u32,
}

impl Writer {
    /// Behind what is there already.
    pub fn onto(out: Vec<u8>) -> Self {
        Writer { out, ..Writer::default() }
    }

    /// The low `n ≤ 16` bits of `value`, which has no others.
    pub fn put(&mut self, value: u32, n: u32) {
        self.bits = self.bits << n | value as u64;
        self.have += n;
        while self.have >= 8 {
            self.have -= 8;
            let byte = (self.bits >> self.have) as u8;
            self.out.push(byte);
            if byte == 0xFF {
                self.out.push(0);
            }
        }
    }

    /// Ones up to the next byte.
    pub fn pad(&mut self) {
        let n = (8 - self.have) % 8;
        self.put((1 << n) - 1, n);
    }
}

/// The size of a number, and the bits that tell it among those of its size.
pub fn sized(value: i32) -> (u32, u32) {
    let n = 32 - value.unsigned_abs().leading_zeros();
    let bits = if value < 0 { value - 1 } else { value } as u32;
    (n, bits & ((1u32 << n) - 1))
}

/// A Huffman code.
#[derive(Clone)]
pub struct Code {
    /// How many codes there are of each length from 1 on, and their symbols in order.
    pub counts: [u8; 16],
    pub symbols: Vec<u8>,
    /// By the first ten bits: length and symbol; 0 for codes that are longer.
    fast: Vec<u16>,
    /// By symbol: its bits and their number, 0 for a symbol without a code.
    codes: [(u16, u8); 256],
}

impl Code {
    pub fn new(counts: [u8; 16], symbols: &[u8]) -> Result<Self, Unsupported> {
        const WRONG: Unsupported = Unsupported("it is damaged: a Huffman table that contradicts itself");
        if counts.iter().map(|&c| c as usize).sum::<usize>() != symbols.len() {
            return Err(WRONG);
        }
        let (mut fast, mut codes) = (vec![0u16; 1 << 10], [(0u16, 0u8); 256]);
        let (mut next, mut at) = (0u32, 0);
        for length in 1..=16u32 {
            for _ in 0..counts[length as usize - 1] {
                if next >> length != 0 {
                    return Err(WRONG);
                }
                let symbol = symbols[at];
                codes[symbol as usize] = (next as u16, length as u8);
                if length <= 10 {
                    let first = (next << (10 - length)) as usize;
                    fast[first..first + (1 << (10 - length))].fill((length as u16) << 8 | symbol as u16);
                }
                (next, at) = (next + 1, at + 1);
            }
            next <<= 1;
        }
        Ok(Code { counts, symbols: symbols.to_vec(), fast, codes })
    }

    /// Length and symbol of the code that `bits` begin with.
    fn find(&self, bits: u16) -> Option<(u32, u8)> {
        let entry = self.fast[bits as usize >> 6];
        if entry != 0 {
            return Some((entry as u32 >> 8, entry as u8));
        }
        let (mut first, mut at) = (0u32, 0u32);
        for length in 1..=16u32 {
            let count = self.counts[length as usize - 1] as u32;
            if let Some(k) = (bits as u32 >> (16 - length)).checked_sub(first).filter(|&k| k < count) {
                return Some((length, self.symbols[(at + k) as usize]));
            }
            (first, at) = (first + count << 1, at + count);
        }
        None
    }

    /// Write a symbol; whether it has a code.
    pub fn write(&self, out: &mut Writer, symbol: u8) -> bool {
        let (code, length) = self.codes[symbol as usize];
        out.put(code as u32, length as u32);
        length > 0
    }

    /// The best code for symbols that are so frequent, with no code of ones only (T.81, K.2).
    pub fn best(frequencies: &[u64; 256]) -> Self {
        // One more symbol, the rarest, takes the code of ones.
        let mut weight = [0u64; 257];
        weight[..256].copy_from_slice(frequencies);
        weight[256] = 1;
        let mut size = [0usize; 257];
        let mut chain = [usize::MAX; 257];
        loop {
            let rarest = |other: Option<usize>| {
                (0..257).filter(|&i| weight[i] > 0 && Some(i) != other).min_by_key(|&i| (weight[i], 257 - i))
            };
            let Some(a) = rarest(None) else { break };
            let Some(b) = rarest(Some(a)) else { break };
            weight[a] += weight[b];
            weight[b] = 0;
            let mut i = a;
            size[i] += 1;
            while chain[i] != usize::MAX {
                i = chain[i];
                size[i] += 1;
            }
            chain[i] = b;
            while chain[i] != usize::MAX {
                i = chain[i];
                size[i] += 1;
            }
        }
        let mut of_size = [0usize; 258];
        size.iter().filter(|&&s| s > 0).for_each(|&s| of_size[s] += 1);
        for long in (17..258).rev() {
            while of_size[long] > 0 {
                let Some(short) = (1..long - 1).rev().find(|&s| of_size[s] > 0) else { break };
                of_size[long] -= 2;
                of_size[long - 1] += 1;
                of_size[short + 1] += 2;
                of_size[short] -= 1;
            }
        }
        if let Some(longest) = (1..=16).rev().find(|&s| of_size[s] > 0) {
            of_size[longest] -= 1;
        }
        let counts = std::array::from_fn(|k| of_size[k + 1] as u8);
        let mut symbols: Vec<u8> = (0..=255).filter(|&s| size[s as usize] > 0).collect();
        symbols.sort_by_key(|&s| size[s as usize]);
        // Sizes of a tree always fit.
        Code::new(counts, &symbols).unwrap_or(Code { counts, symbols, fast: vec![0; 1 << 10], codes: [(0, 0); 256] })
    }
}

/// Where symbols go: first to be counted, then to be written.
pub trait Sink {
    fn symbol(&mut self, table: usize, symbol: u8);
    fn bits(&mut self, value: u32, n: u32);
}

/// Counts symbols by table.
pub struct Tally(pub [[u64; 256]; 2]);

impl Sink for Tally {
    fn symbol(&mut self, table: usize, symbol: u8) {
        self.0[table][symbol as usize] += 1;
    }

    fn bits(&mut self, _: u32, _: u32) {}
}

/// Writes them with the codes that the counts have led to.
pub struct Pen {
    pub codes: [Code; 2],
    pub out: Writer,
}

impl Sink for Pen {
    fn symbol(&mut self, table: usize, symbol: u8) {
        self.codes[table].write(&mut self.out, symbol);
    }

    fn bits(&mut self, value: u32, n: u32) {
        self.out.put(value, n);
    }
}
