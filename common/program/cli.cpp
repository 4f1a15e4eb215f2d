#include "common/program/cli.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/base/text.hpp"
#include "common/version.hpp"

namespace tether {
namespace {

/// Text for man(7): no backslash, hyphen or leading dot that roff would take for its own.
std::string roff(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if ((c == '.' || c == '\'') && (out.empty() || out.back() == '\n')) out += "\\&";
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  return out;
}

/// The part of `--help` that says how an option is used; its type and range are in words there.
std::string option_head(const CLI::Option& option) {
  std::string head = roff(option.get_name(false, true));
  if (option.get_positional()) head = roff(option.get_name(true));
  head = fmt::format("\\fB{}\\fR", head);
  if (option.get_items_expected_max() == 0) return head;
  if (const std::string type = option.get_type_name(); !type.empty()) {
    head += " \\fI" + roff(type) + "\\fR";
  }
  if (const std::string value = option.get_default_str(); !value.empty()) {
    head += fmt::format(" [{}]", roff(value));
  }
  return head;
}

std::string options_of(const CLI::App& app) {
  std::string out;
  for (const CLI::Option* option : app.get_options()) {
    const bool is_help = option == app.get_help_ptr() && app.get_parent() != nullptr;
    if (option->get_group().empty() || is_help) continue;  // hidden, or said once for all
    out += fmt::format(".TP\n{}\n{}{}\n", option_head(*option), roff(option->get_description()),
                       option->get_required() ? " (required)" : "");
    if (const std::string name = option->get_envname(); !name.empty()) {
      out += fmt::format("(environment: {})\n", roff(name));
    }
    for (const CLI::Option* other : option->get_needs()) {
      out += fmt::format("(needs {})\n", roff(other->get_name()));
    }
  }
  return out;
}

std::string usage(const CLI::App& app, const std::string& path) {
  std::string out = fmt::format("\\fB{}\\fR [\\fIoptions\\fR]", roff(path));
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_positional()) out += fmt::format(" \\fI{}\\fR", roff(option->get_name(true)));
  }
  return out;
}

/// Last lines of `--help`: paragraphs, in which man(7) keeps the lines that begin with a space.
std::string footer_of(const CLI::App& app) {
  const std::string footer = app.get_footer();
  std::string out;
  for (std::size_t begin = 0; begin < footer.size();) {
    const std::size_t end = std::min(footer.find("\n\n", begin), footer.size());
    out += ".P\n" + roff(footer.substr(begin, end - begin)) + "\n";
    begin = end + 2;
  }
  return out;
}

/// Visits each command that does something: itself, and its subcommands.
void for_each_command(const CLI::App& app, const std::string& path, const auto& visit) {
  visit(app, path);
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    for_each_command(*sub, path + " " + sub->get_name(), visit);
  }
}

std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

/// The choice of CLI::IsMember, which is in the type's name only: "TEXT:{one,other}".
std::vector<std::string> choices(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const auto begin = type.find('{'), end = type.find('}');
  if (begin == std::string::npos || end == std::string::npos) return {};
  std::vector<std::string> all;
  std::string one;
  for (const char c : type.substr(begin + 1, end - begin - 1)) {
    if (c != ',') {
      one += c;
    } else {
      all.push_back(std::exchange(one, {}));
    }
  }
  all.push_back(one);
  return all;
}

constexpr std::string_view kBash = R"sh({function}() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} command={program} i
    COMPREPLY=()
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "$command ${{COMP_WORDS[i]}}" in
            {paths}) command="$command ${{COMP_WORDS[i]}}" ;;
        esac
    done
    case "$command $previous" in
        *' --set')
            COMPREPLY=($(compgen -S= -W "$({program} run --keys 2>/dev/null | awk '$1 ~ /[.]/ {{ print $1 }}')" -- "$current"))
            compopt -o nospace 2>/dev/null
            return ;;
{values}    esac
    case "$command" in
{words}    esac
}}
complete -o default -F {function} {program}
)sh";

/// zsh runs the file itself at the first completion of a session.
constexpr std::string_view kZshEnd = R"sh(if [[ ${{funcstack[1]}} == _{program} ]]; then
    _bash_complete -o default -F {function}
fi
)sh";

/// A name that a function of a shell may have.
std::string function_name(const CLI::App& app) {
  std::string function = "_" + app.get_name() + "_words";
  std::replace(function.begin(), function.end(), '-', '_');
  return function;
}

std::string bash_script(const CLI::App& app) {
  std::set<std::string> paths;
  std::string values, words;
  const auto reply = [](const std::vector<std::string>& all) {
    return fmt::format(R"sh(COMPREPLY=($(compgen -W '{}' -- "$current")))sh", fmt::join(all, " "));
  };
  for_each_command(app, app.get_name(), [&](const CLI::App& command, const std::string& path) {
    paths.insert(fmt::format("'{}'", path));
    std::vector<std::string> all = option_names(command);
    for (const CLI::App* sub : command.get_subcommands([](const CLI::App*) { return true; })) {
      all.push_back(sub->get_name());
    }
    for (const CLI::Option* option : command.get_options()) {
      const std::vector<std::string> choice = choices(*option);
      if (choice.empty()) continue;
      if (option->get_positional()) all.insert(all.end(), choice.begin(), choice.end());
      for (const std::string& name : option->get_lnames()) {
        values += fmt::format("        '{} --{}') {}; return ;;\n", path, name, reply(choice));
      }
    }
    words += fmt::format("        '{}') {} ;;\n", path, reply(all));
  });
  return fmt::format(kBash, fmt::arg("function", function_name(app)),
                     fmt::arg("program", app.get_name()), fmt::arg("paths", fmt::join(paths, "|")),
                     fmt::arg("values", values), fmt::arg("words", words));
}

}  // namespace

std::string manual_page(const CLI::App& app) {
  std::string commands;
  for_each_command(app, app.get_name(), [&](const CLI::App& command, const std::string& path) {
    if (&command == &app) return;
    commands += fmt::format(".SS {}\n{}\n.P\n{}.\n{}{}", roff(path.substr(path.find(' ') + 1)),
                            usage(command, path), roff(command.get_description()),
                            options_of(command), footer_of(command));
  });
  std::string page = fmt::format(
      ".TH {} 1 \"\" \"Tether {}\" \"Tether\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n{}{}\n"
      ".SH OPTIONS\n{}",
      roff(app.get_name()), roff(kVersion), roff(app.get_name()), roff(app.get_description()),
      usage(app, app.get_name()), commands.empty() ? "" : " \\fIcommand\\fR ...", options_of(app));
  if (!commands.empty()) page += ".SH COMMANDS\n" + commands;
  page += ".SH EXIT STATUS\n0: done. 1: failed, or a run that is not valid. 2: bad input.\n";
  if (!app.get_footer().empty()) page += ".SH EXAMPLES\n" + footer_of(app);
  return page;
}

std::string completion_script(const CLI::App& app, const std::string& shell) {
  if (shell == "bash") return bash_script(app);
  if (shell != "zsh") {
    throw UsageError(fmt::format("--completion: \"{}\" must be bash or zsh", shell));
  }
  return fmt::format("#compdef {}\nautoload -U +X bashcompinit && bashcompinit\n{}{}",
                     app.get_name(), bash_script(app),
                     fmt::format(kZshEnd, fmt::arg("program", app.get_name()),
                                 fmt::arg("function", function_name(app))));
}

namespace {

/// CLI11's error in the format of other errors, with the --help to read.
std::string in_our_words(const CLI::App* app, const CLI::Error& error) {
  std::string whole = app->get_name();
  for (const auto* sub = app; !sub->get_subcommands().empty();) {
    sub = sub->get_subcommands().front();
    whole += " " + sub->get_name();
  }
  return fmt::format("{}: error: {}; see {} --help\n", app->get_name(), error.what(), whole);
}

}  // namespace

int run_cli(CLI::App& app, int argc, char** argv, const std::function<int()>& body) {
  const auto complain = [&app](const char* what) {
    std::fflush(stdout);
    say(Severity::error, fmt::format("{}: error: {}", app.get_name(), printable_message(what)));
  };
  try {
    app.parse(argc, argv);
    const int code = body();
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
      throw std::runtime_error("cannot write to standard output");
    }
    return code;
  } catch (const CLI::ParseError& error) {
    app.failure_message(in_our_words);
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  } catch (const UsageError& error) {
    complain(error.what());
    return kExitUsage;
  } catch (const std::invalid_argument& error) {
    complain(error.what());
    return kExitUsage;
  } catch (const std::exception& error) {
    complain(error.what());
    return kExitFailed;
  }
}

void add_about(CLI::App& app) {
  app.set_version_flag("--version", fmt::format("{} {}", app.get_name(), kVersion));
  // Ends the parsing as --version does, whatever else is required.
  const auto print = [](const std::string& text) { throw CLI::CallForVersion(text, 0); };
  app.add_flag_callback(
      "--man", [&app, print] { print(manual_page(app)); }, "Print the manual page: | man -l -");
  app.add_option_function<std::string>(
         "--completion",
         [&app, print](const std::string& shell) { print(completion_script(app, shell)); },
         "Print the completion script for a shell")
      ->check(CLI::IsMember({"bash", "zsh"}))
      ->trigger_on_parse();
}

void add_examples(CLI::App& command, const std::vector<std::string>& lines) {
  const std::string before = command.get_footer();
  command.footer(fmt::format("{}Examples:\n  {}", before.empty() ? "" : before + "\n\n",
                             fmt::join(lines, "\n  ")));
}

}  // namespace tether
