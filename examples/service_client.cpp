// Ask `mantaray serve synthetic:beaufort` for a ping, with libcurl and nlohmann/json:
//
//     apt install libcurl4-openssl-dev nlohmann-json3-dev
//     g++ -std=c++17 service_client.cpp -o ping -lcurl && ./ping
//
// It prints
//
//     B: ok at 121.07665486284169 s
//     C: outside

#include <curl/curl.h>
#include <nlohmann/json.hpp>
#include <iostream>
#include <stdexcept>
#include <string>

using nlohmann::json;

// One connection to a server of ranges, kept open from ping to ping.
class Ranging {
 public:
  explicit Ranging(const std::string& url) : curl_(curl_easy_init()) {
    curl_easy_setopt(curl_, CURLOPT_URL, (url + "/ping").c_str());
    curl_easy_setopt(curl_, CURLOPT_WRITEFUNCTION, &Ranging::append);
    curl_easy_setopt(curl_, CURLOPT_WRITEDATA, &answer_);
  }
  ~Ranging() { curl_easy_cleanup(curl_); }
  Ranging(const Ranging&) = delete;
  Ranging& operator=(const Ranging&) = delete;

  json ping(const json& request) {
    const std::string body = request.dump();
    answer_.clear();
    curl_easy_setopt(curl_, CURLOPT_POSTFIELDSIZE, static_cast<long>(body.size()));
    curl_easy_setopt(curl_, CURLOPT_COPYPOSTFIELDS, body.c_str());
    if (const CURLcode code = curl_easy_perform(curl_); code != CURLE_OK)
      throw std::runtime_error(curl_easy_strerror(code));
    json answer = json::parse(answer_);
    if (answer.contains("error")) throw std::runtime_error(answer["error"]);
    return answer;
  }

 private:
  static size_t append(char* data, size_t size, size_t count, void* text) {
    static_cast<std::string*>(text)->append(data, size * count);
    return size * count;
  }
  CURL* curl_;
  std::string answer_;
};

int main() {
  Ranging ranging("http://127.0.0.1:8642");
  const json answer = ranging.ping({
      {"time", 120.0},
      {"source", {{"north", 0.0}, {"east", 0.0}, {"depth", 50.0}}},
      {"receivers", {{{"name", "B"}, {"north", 1500.0}, {"east", -400.0}, {"depth", 120.0}},
                     {{"name", "C"}, {"north", 900.0}, {"east", 300.0}, {"depth", 5000.0}}}},
  });
  for (const json& end : answer["receivers"]) {
    std::cout << end["name"].get<std::string>() << ": " << end["status"].get<std::string>();
    if (!end["arrival_time"].is_null()) std::cout << " at " << end["arrival_time"] << " s";
    std::cout << '\n';
  }
}
