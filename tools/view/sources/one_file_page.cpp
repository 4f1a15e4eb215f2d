#include "tools/view/sources/one_file_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <vector>

#include "common/base/errors.hpp"
#include "tools/base/json.hpp"
#include "tools/view/sources/gzip.hpp"

namespace tether {
namespace {

constexpr char kPolicy[] =
    R"(<meta http-equiv="Content-Security-Policy" content="default-src 'none'; )"
    R"(script-src 'unsafe-inline' data:; style-src 'unsafe-inline' data:; img-src data: blob:">)";

std::string bare_name(const std::string& path) { return "tether/" + path; }

std::string need(const ReadPageFile& read, const std::string& path) {
  std::optional<std::string> bytes = read(path);
  if (!bytes) throw UsageError("the page lacks its file " + path);
  return std::move(*bytes);
}

std::string data_url(const std::string& path, const std::string& bytes) {
  std::string type = media_type(path);
  std::erase(type, ' ');
  return "data:" + type + ";base64," + base64(bytes);
}

/// Import map of the module and all that it imports, in the order in which they are found.
std::string import_map(const ReadPageFile& read, const std::string& path) {
  std::vector<std::string> paths{path};
  nlohmann::ordered_json imports = nlohmann::ordered_json::object();
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const std::string here = paths[i];
    const std::string module =
        with_bare_imports(need(read, here), here, [&paths](const std::string& imported) {
          if (std::ranges::find(paths, imported) == paths.end()) paths.push_back(imported);
        });
    imports[bare_name(here)] = data_url(here, module);
  }
  return json_text(nlohmann::ordered_json{{"imports", std::move(imports)}});
}

/// Inserts `text` after `place`, which must exist.
void insert_after(std::string& html, std::string_view place, std::string_view text) {
  const std::size_t found = html.find(place);
  if (found == std::string::npos) throw UsageError(fmt::format("index.html has no {}", place));
  html.insert(found + place.size(), text);
}

/// The text with each match replaced by what `make` makes of it.
template <class Make>
std::string replaced(const std::string& text, const std::regex& pattern, Make make) {
  std::string out;
  auto rest = text.cbegin();
  for (std::sregex_iterator it(text.begin(), text.end(), pattern), end; it != end; ++it) {
    out.append(rest, (*it)[0].first);
    out += make(*it);
    rest = (*it)[0].second;
  }
  out.append(rest, text.cend());
  return out;
}

}  // namespace

ReadPageFile files_of(const PageFolder& folder) {
  return [&folder](const std::string& path) -> std::optional<std::string> {
    auto file = folder.find("/" + path);
    if (!file) return std::nullopt;
    return std::move(file->bytes);
  };
}

std::string with_bare_imports(const std::string& module, const std::string& path,
                              const std::function<void(const std::string&)>& imported) {
  static const std::regex kImport(R"re(\b(from|import) "(\.\.?/[^"\n]+\.js)")re");
  const auto folder = std::filesystem::path(path).parent_path();
  return replaced(module, kImport, [&](const std::smatch& match) {
    const std::string name = (folder / match.str(2)).lexically_normal().generic_string();
    imported(name);
    return fmt::format("{} \"{}\"", match.str(1), bare_name(name));
  });
}

std::string one_file_page(const ReadPageFile& read, std::string_view recording_base64) {
  static const std::regex kModule(R"re(<script type="module" src="([^":]+)"></script>)re");
  static const std::regex kFile(R"re(\b(src|href)="([^":#]+)")re");
  std::string html = need(read, "index.html");
  insert_after(html, "<html", " data-recording");
  insert_after(html, "<meta charset=\"utf-8\">", std::string("\n  ") + kPolicy);
  html = replaced(html, kFile, [&](const std::smatch& match) {
    const std::string path = match.str(2);
    if (match.prefix().str().ends_with("type=\"module\" ")) return match.str();
    return fmt::format("{}=\"{}\"", match.str(1), data_url(path, need(read, path)));
  });
  html = replaced(html, kModule, [&](const std::smatch& match) {
    return fmt::format(
        "<script type=\"importmap\">{}</script>\n"
        "  <script type=\"module\">import \"{}\";</script>",
        import_map(read, match.str(1)), bare_name(match.str(1)));
  });
  const std::size_t end = html.rfind("</body>");
  if (end == std::string::npos) throw UsageError("index.html has no </body>");
  html.insert(end, fmt::format("<script id=\"recording\" type=\"text/plain\">{}</script>\n",
                               recording_base64));
  return html;
}

}  // namespace tether
