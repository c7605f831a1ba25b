// palpate-ultraleap's command line.
#pragma once

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "focus_file.hpp"
#include "server.hpp"

namespace palpate {

constexpr char usage[] =
    R"(palpate-ultraleap hands palpate's focal points to an Ultraleap array, through the vendor's library.

  palpate-ultraleap [--listen ADDRESS] [--port N] [--once]   serves palpate (127.0.0.1, port 24040), until Ctrl-C
  palpate-ultraleap play FILE [--repeat N]                   plays a binary file of focal points
  palpate-ultraleap --list                                   lists the arrays that the library finds

  --port N      port that palpate connects to; 0 takes any that is free, and prints it
  --listen A    address that it listens at; any but a loopback address lets others play on the array
  --once        ends when the first client is gone
  --repeat N    plays the file so many times, without a pause
  --device ID   the array, as USX:00000001; MockDevice:USX is the library's own model of one. Default: the first
  --connect C   way to the library's service: direct (without it) or local:PATH. Default: the library's own
  --version, --help

Exit codes: 0 done, 1 failed or interrupted, 2 a wrong command line.
)";

struct Options {
  std::string command = "serve";  // or play, list, version, help
  std::string file, address = "127.0.0.1";
  unsigned port = 24040;
  std::uint64_t repeats = 1;
  bool is_once = false;
  ArrayOptions array;
};

inline std::uint64_t whole_number(const std::string& option, const std::string& text, std::uint64_t least, std::uint64_t most) {
  bool is_number = !text.empty() && text.size() < 10 && text.find_first_not_of("0123456789") == std::string::npos;
  std::uint64_t value = is_number ? std::stoull(text) : 0;
  if (!is_number || value < least || value > most)
    throw Misuse(option + " must be a whole number from " + std::to_string(least) + " to " + std::to_string(most) + ", not '" +
                 text + "'");
  return value;
}

inline Options read_options(const std::vector<std::string>& words) {
  Options options;
  std::vector<std::string> given;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    auto value = [&]() -> const std::string& {
      if (i + 1 == words.size()) throw Misuse(word + (word == "play" ? " needs a file of focal points" : " needs a value"));
      return words[++i];
    };
    if (i == 0 && word == "play") {
      options.command = "play";
      options.file = value();
    } else if (word == "--help" || word == "-h" || word == "--version" || word == "--list") {
      options.command = word == "-h" ? "help" : word.substr(2);
    } else if (word == "--listen") {
      options.address = value();
    } else if (word == "--port") {
      options.port = static_cast<unsigned>(whole_number(word, value(), 0, 65535));
    } else if (word == "--once") {
      options.is_once = true;
    } else if (word == "--repeat") {
      options.repeats = whole_number(word, value(), 1, 999999999);
    } else if (word == "--device") {
      options.array.device = value();
    } else if (word == "--connect") {
      options.array.connect = value();
    } else {
      throw Misuse("'" + word + "' is unknown" + (word == "play" || options.command == "play" ? " here: play FILE comes first" : "") +
                   ": --help lists what there is");
    }
    given.push_back(word);
  }
  for (const std::string& word : given) {
    bool is_served = word == "--listen" || word == "--port" || word == "--once";
    if ((is_served && options.command == "play") || (word == "--repeat" && options.command == "serve"))
      throw Misuse(word + " is not for " + (options.command == "play" ? "play" : "serving"));
  }
  const std::string& connect = options.array.connect;
  if (!connect.empty() && connect != "direct" && connect.compare(0, 6, "local:") != 0)
    throw Misuse("--connect must be direct or local:PATH, not '" + connect + "'");
  return options;
}

inline int run_command(const Options& options) {
  if (options.command == "help") {
    std::fputs(usage, stdout);
    return 0;
  }
  if (options.command == "version") {
    say("palpate-ultraleap, messages of version " + std::to_string(protocol_version) + ", compiled against " + sdk_name());
    return 0;
  }
  if (options.command == "list") {
    std::vector<std::string> found = list_arrays(options.array);
    for (const std::string& identifier : found) say(identifier);
    if (found.empty()) throw Failure("the library finds no array (is it plugged in and switched on?)");
    return 0;
  }
  EndSignal::watch();
  Socket::prepare_system();
  std::unique_ptr<FocusFile> file;
  if (options.command == "play") file.reset(new FocusFile(options.file));  // judged before the array is claimed
  Player player;
  std::unique_ptr<FocusArray> array = open_array(options.array, player);
  Session session(*array, player);
  if (file) return play_file(*file, options.repeats, *array, player, session);
  return Server(*array, player, session).serve(options.address, options.port, options.is_once);
}

inline int run(int count, char** words) {
  int code = 1;
  try {
    code = run_command(read_options(std::vector<std::string>(words + 1, words + count)));
  } catch (const Misuse& misuse) {
    std::fprintf(stderr, "palpate-ultraleap: %s\n", misuse.what());
    code = 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpate-ultraleap: %s\n", error.what());
  }
  EndSignal::set_off();
  return code;
}

}  // namespace palpate
