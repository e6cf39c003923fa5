// report_page.h: a page of text, tables and pictures, written as HTML and as Markdown. For reproduce_paper.cpp.
#pragma once

#include "amps/amps.h"
#include "render_png.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

class Page {
 public:
  /// Pictures go beside the page, into this directory, which is there.
  explicit Page(std::filesystem::path directory) : directory_(std::move(directory)) {}

  void heading(const std::string& text, int level = 2) {
    const std::string tag = "h" + std::to_string(level);
    html_ += "<" + tag + ">" + escaped(text) + "</" + tag + ">\n";
    markdown_ += std::string(static_cast<std::size_t>(level), '#') + " " + text + "\n\n";
  }
  void text(const std::string& text) {
    html_ += "<p>" + escaped(text) + "</p>\n";
    markdown_ += text + "\n\n";
  }
  void list(const std::vector<std::string>& items) {
    html_ += "<ul>\n";
    for (const std::string& item : items) {
      html_ += "<li>" + escaped(item) + "</li>\n";
      markdown_ += "- " + item + "\n";
    }
    html_ += "</ul>\n";
    markdown_ += "\n";
  }
  /// The first column is names; rows that begin with `other` are set apart.
  void table(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows,
             const std::string& other) {
    html_ += "<div class=\"wide\"><table><tr>";
    std::string rule = "|";
    markdown_ += "|";
    for (const std::string& cell : head) {
      html_ += "<th>" + escaped(cell) + "</th>";
      markdown_ += " " + in_cell(cell) + " |";
      rule += "---|";
    }
    html_ += "</tr>\n";
    markdown_ += "\n" + rule + "\n";
    for (const auto& row : rows) {
      html_ += row.front().rfind(other, 0) == 0 ? "<tr class=\"other\">" : "<tr>";
      markdown_ += "|";
      for (const std::string& cell : row) {
        const std::size_t range = &cell == &row.front() ? std::string::npos : cell.find(" (");  // on a line of its own
        html_ += "<td>" + escaped(cell.substr(0, range)) +
                 (range == std::string::npos ? "" : "<br><small>" + escaped(cell.substr(range + 1)) + "</small>") + "</td>";
        markdown_ += " " + in_cell(cell) + " |";
      }
      html_ += "</tr>\n";
      markdown_ += "\n";
    }
    html_ += "</table></div>\n";
    markdown_ += "\n";
  }
  void picture(const std::string& name, const render::Image& image, const std::string& caption) {
    write(directory_ / name, render::encode_png(image, {}));
    html_ += "<figure><img src=\"" + name + "\" width=\"" + std::to_string(image.width) + "\" alt=\"" + escaped(caption) +
             "\"><figcaption>" + escaped(caption) + "</figcaption></figure>\n";
    markdown_ += "![" + caption + "](" + name + ")\n\n*" + caption + "*\n\n";
  }

  /// index.html and index.md.
  void save(const std::string& title) const {
    const std::string head =
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + escaped(title) +
        "</title>\n<meta name=\"viewport\" content=\"width=device-width\">\n<style>\n"
        "body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;color:#222}\n"
        "table{border-collapse:collapse;font-size:.85rem;margin:1rem 0}th,td{padding:.25rem .6rem;text-align:right;"
        "border-bottom:1px solid #ddd;vertical-align:top}th:first-child,td:first-child{text-align:left}\n"
        ".wide{overflow-x:auto}tr.other td{color:#555;background:#f4f4f6}figure{margin:1.5rem "
        "0}img{max-width:100%;height:auto}\n"
        "figcaption{color:#444}\n</style></head><body>\n";
    write(directory_ / "index.html", head + html_ + "</body></html>\n");
    write(directory_ / "index.md", markdown_);
  }

 private:
  static std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
      if (c == '&') {
        out += "&amp;";
      } else if (c == '<') {
        out += "&lt;";
      } else if (c == '>') {
        out += "&gt;";
      } else if (c == '"') {
        out += "&quot;";
      } else {
        out += c;
      }
    }
    return out;
  }
  static std::string in_cell(const std::string& text) {
    std::string out;
    for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
    return out;
  }
  static void write(const std::filesystem::path& path, const std::string& bytes) {
    std::ofstream out(path, std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.close();
    if (!out) throw std::runtime_error("cannot write " + path.string());
  }

  std::filesystem::path directory_;
  std::string html_, markdown_;
};
