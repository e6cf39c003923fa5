// render_png.h: pictures of pixels, and how they are written: a PNG encoder of our own. It needs nothing but amps::Execution
// and the standard library, and is part of the program, not of the library.
#pragma once

#include "amps/amps.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace render {

struct Image {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;  ///< width · height · 3, row by row from the top, sRGB
};

namespace detail {

/// Deflate (RFC 1951): one block, fixed Huffman codes, matches found by hash chains.
class Deflater {
 public:
  std::string compress(const std::vector<std::uint8_t>& data, const amps::Execution& execution) {
    constexpr std::size_t kBytesPerLook = 1 << 16;
    std::size_t next_look = 0;
    put_bits(1, 1);  // last block
    put_bits(1, 2);  // fixed codes
    std::vector<std::int64_t> newest(std::size_t{1} << kHashBits, -1);
    std::vector<std::int64_t> older(kWindow, -1);  // by position modulo the window
    const auto remember = [&](std::size_t i) {
      if (i + 3 > data.size()) return;
      const std::size_t h = hash(&data[i]);
      older[i % kWindow] = newest[h];
      newest[h] = static_cast<std::int64_t>(i);
    };
    for (std::size_t i = 0; i < data.size();) {
      if (i >= next_look) {
        next_look = i + kBytesPerLook;
        execution.report(static_cast<double>(i) / static_cast<double>(data.size()));
      }
      std::size_t best = 0, best_distance = 0;
      if (i + 3 <= data.size()) {
        const std::size_t longest = std::min<std::size_t>(258, data.size() - i);
        std::int64_t candidate = newest[hash(&data[i])];
        for (int tries = 0; tries < 48 && candidate >= 0 && i - static_cast<std::size_t>(candidate) < kWindow; ++tries) {
          const auto from = static_cast<std::size_t>(candidate);
          std::size_t length = 0;
          while (length < longest && data[from + length] == data[i + length]) ++length;
          if (length > best) {
            best = length;
            best_distance = i - from;
          }
          candidate = older[from % kWindow];
        }
      }
      if (best < 3) best = 1;
      if (best == 1) {
        put_symbol(data[i]);
      } else {
        put_match(best, best_distance);
      }
      for (std::size_t k = 0; k < best; ++k) remember(i + k);
      i += best;
    }
    put_symbol(256);
    put_bits(0, 7);  // fills the last byte
    return std::move(out_);
  }

 private:
  static constexpr int kHashBits = 15;
  static constexpr std::size_t kWindow = 32768;

  static std::size_t hash(const std::uint8_t* p) {
    const std::uint32_t x =
        static_cast<std::uint32_t>(p[0]) | static_cast<std::uint32_t>(p[1]) << 8 | static_cast<std::uint32_t>(p[2]) << 16;
    return (x * 2654435761u) >> (32 - kHashBits);
  }
  void put_bits(std::uint32_t bits, int count) {
    buffer_ |= bits << used_;
    for (used_ += count; used_ >= 8; used_ -= 8, buffer_ >>= 8) out_ += static_cast<char>(buffer_ & 255);
  }
  void put_code(std::uint32_t code, int length) {  // Huffman codes go out from their highest bit
    for (int k = length - 1; k >= 0; --k) put_bits(code >> k & 1, 1);
  }
  void put_symbol(std::uint32_t s) {
    if (s < 144) return put_code(0x30 + s, 8);
    if (s < 256) return put_code(0x190 + s - 144, 9);
    if (s < 280) return put_code(s - 256, 7);
    put_code(0xC0 + s - 280, 8);
  }
  /// Lengths 3–258 and distances 1–32768 share one scheme: 2^extra values a symbol, extra growing every `step` symbols.
  void put_match(std::size_t length, std::size_t distance) {
    if (length == 258) {
      put_symbol(285);
    } else {
      put_split(static_cast<std::uint32_t>(length - 3), 4, [this](std::uint32_t s) { put_symbol(257 + s); });
    }
    put_split(static_cast<std::uint32_t>(distance - 1), 2, [this](std::uint32_t s) { put_code(s, 5); });
  }
  template <class Put>
  void put_split(std::uint32_t value, std::uint32_t step, Put put) {
    int extra = 0;
    while (value >> extra >= 2 * step) ++extra;
    put(static_cast<std::uint32_t>(extra) * step + (value >> extra));
    put_bits(value & ((1u << extra) - 1), extra);
  }

  std::string out_;
  std::uint32_t buffer_ = 0;
  int used_ = 0;
};

inline void put_uint32(std::string& out, std::uint32_t x) {
  for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(x >> shift & 255);
}

inline void put_chunk(std::string& out, const char* type, const std::string& data) {
  put_uint32(out, static_cast<std::uint32_t>(data.size()));
  const std::string body = type + data;
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const char c : body) {
    crc ^= static_cast<std::uint8_t>(c);
    for (int k = 0; k < 8; ++k) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xEDB88320u : 0u);
  }
  out += body;
  put_uint32(out, crc ^ 0xFFFFFFFFu);
}

/// Rows predicted by one of the five PNG filters each, the one that leaves the least to say.
inline std::vector<std::uint8_t> filter_rows(const Image& image, const amps::Execution& execution) {
  const std::size_t stride = static_cast<std::size_t>(image.width) * 3;
  std::vector<std::uint8_t> above(stride, 0), row(stride), best(stride), out;
  for (std::size_t y = 0; y < static_cast<std::size_t>(image.height); ++y) {
    execution.report(static_cast<double>(y) / image.height);
    const std::uint8_t* now = &image.rgb[y * stride];
    long best_cost = std::numeric_limits<long>::max();
    std::uint8_t best_filter = 0;
    for (std::uint8_t filter = 0; filter < 5; ++filter) {
      long cost = 0;
      for (std::size_t i = 0; i < stride; ++i) {
        const int a = i < 3 ? 0 : now[i - 3], b = above[i], c = i < 3 ? 0 : above[i - 3];
        const int pa = std::abs(b - c), pb = std::abs(a - c), pc = std::abs(a + b - 2 * c);
        const int paeth = pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
        const int predicted[5] = {0, a, b, (a + b) / 2, paeth};
        row[i] = static_cast<std::uint8_t>(now[i] - predicted[filter]);
        cost += std::abs(static_cast<std::int8_t>(row[i]));
      }
      if (cost < best_cost) {
        best_cost = cost;
        best_filter = filter;
        best.swap(row);
      }
    }
    out.push_back(best_filter);
    out.insert(out.end(), best.begin(), best.end());
    above.assign(now, now + stride);
  }
  return out;
}

}  // namespace detail

/// The bytes of a PNG file (8-bit RGB).
inline std::string encode_png(const Image& image, const amps::Execution& execution) {
  using namespace detail;
  const amps::Execution job = execution.start("writing");
  std::string header;
  put_uint32(header, static_cast<std::uint32_t>(image.width));
  put_uint32(header, static_cast<std::uint32_t>(image.height));
  header += std::string("\x08\x02\x00\x00\x00", 5);  // 8 bits, RGB, deflate, adaptive filters, not interlaced

  const std::vector<std::uint8_t> rows = filter_rows(image, job.part(0, 0.5));
  std::uint32_t a = 1, b = 0;  // Adler-32
  for (const std::uint8_t byte : rows) {
    a = (a + byte) % 65521;
    b = (b + a) % 65521;
  }
  std::string data = "\x78\x01";  // zlib: deflate with a 32 KiB window
  data += Deflater().compress(rows, job.part(0.5, 1));
  put_uint32(data, b << 16 | a);

  std::string png = "\x89PNG\r\n\x1a\n";
  put_chunk(png, "IHDR", header);
  put_chunk(png, "IDAT", data);
  put_chunk(png, "IEND", "");
  job.finish();
  return png;
}

}  // namespace render
